"""Studies of what is foretold before anything is taught.

May import what all studies may.
"""
