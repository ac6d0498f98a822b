"""Puts vgrd onto a cell computer, as a service: versions side by side, a link to the one in use.

May import errors only, and nothing that is not Python's own: it runs before vgrd is installed.
"""

import sys

if sys.version_info < (3, 11):  # noqa: UP036  (`make install` may be another Python's; said before it fails on syntax)
    sys.exit(
        "vgrd: needs Python 3.11 or newer, this is an older one; Debian 12 has it: /usr/bin/python3"
    )
