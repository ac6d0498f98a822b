"""The axis about which an object turns.

May import geometry and model.
"""
