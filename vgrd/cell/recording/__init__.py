"""Recording: an operator's samples become sessions on disk.

Runs in the cell process; may import devices, model, store and solving.
"""
