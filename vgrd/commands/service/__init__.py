"""Commands about the service on this machine: install, uninstall, backup, restore.

May import what commands may; see vgrd/commands.
"""

from vgrd.commands.service import backup, installing

GROUPS = (backup, installing)
