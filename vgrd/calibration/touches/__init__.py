"""Touches as equations, and what all methods read from them.

May import observability and model.
"""
