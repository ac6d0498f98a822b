"""Robot controllers on the wire: RTDE, Modbus, and the program that asks for coordinates.

May import world.
"""
