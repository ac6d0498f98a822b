"""`vgrd check`: what will fail with a cell file, told before the daemon runs; line, key and remedy.

What is surely wrong is a fault, what is only odd is a doubt. May import the configuration, the vision and the devices.
"""
