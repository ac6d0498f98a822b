"""Holes of an object, found from where they should be.

May import images.
"""
