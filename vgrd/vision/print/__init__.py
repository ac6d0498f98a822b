"""What is printed: codes of the families, tags, boards, and sheets to print.

May import devices and geometry.
"""
