"""Devices that do not exist, speaking the real protocols, over one simulated world.

May import everything; nothing of the daemon imports them.
"""
