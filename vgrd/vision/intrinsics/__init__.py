"""Intrinsics of a camera from pictures of a board, and files that hold them.

May import images, print, alignment and tags.
"""
