"""What to record next, what it would bring, and what the error consists of.

May import joint and checks.
"""
