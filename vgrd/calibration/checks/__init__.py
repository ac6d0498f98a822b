"""Checks of a recording by its own data: what is missing, what was meant otherwise, what moved."""
