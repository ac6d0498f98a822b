"""Devices that do not exist, speaking the real protocols, over one simulated world."""
