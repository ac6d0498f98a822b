"""What the cell tells about itself, for Prometheus: a process of its own, which nothing waits for.

May import the lines between the processes (ipc) and the status codes; nothing of the cell or the gate.
"""
