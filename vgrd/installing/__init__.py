"""Puts vgrd onto a cell computer, as a service: versions side by side, a link to the one in use.

May import errors only, and nothing that is not Python's own: it runs before vgrd is installed.
"""
