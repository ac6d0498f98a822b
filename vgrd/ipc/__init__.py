"""Data and commands between the processes: rings in memory-mapped files, JSON lines on sockets."""
