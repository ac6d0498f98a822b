"""State and cell file in one archive, for a spare computer and before each update.

May import the store, whose files it knows.
"""

from vgrd.backup.archive import Content, write_archive
from vgrd.backup.restoring import Restored, restore

__all__ = ["Content", "Restored", "restore", "write_archive"]
