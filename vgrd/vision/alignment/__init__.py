"""The photometric fit: a printed pattern aligned with all pixels that show it.

May import images and print. docs/photometric.md derives the inner loop.
"""
