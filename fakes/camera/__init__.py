"""Pictures of the simulated cell, and cameras that send them over real protocols.

May import world.
"""
