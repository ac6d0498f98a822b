"""Pictures: files, noise, warps by lens and plane, drawings.

May import devices and geometry; knows no printed pattern.
"""
