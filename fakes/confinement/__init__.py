"""A process as systemd would confine it: filters, namespaces, a booted machine.

Knows nothing of the cell.
"""
