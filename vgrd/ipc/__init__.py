"""Data and commands between the processes: rings in memory-mapped files, JSON lines on sockets.

Imports errors, clock and permissions only: gate and devices must stay small.
"""
