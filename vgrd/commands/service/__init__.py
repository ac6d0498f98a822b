"""Commands about the service on this machine: install, uninstall, backup, restore, page-password.

May import what commands may; see vgrd/commands.
"""

from vgrd.commands.service import backup, installing, page_password

GROUPS = (backup, installing, page_password)
