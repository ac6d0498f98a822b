"""What the page shows, a class for each tab.

May import the parts of the page, not the screen.
"""

from vgrd.page.tabs.cell import CellTab
from vgrd.page.tabs.result import ResultTab
from vgrd.page.tabs.runtime import RuntimeTab
from vgrd.page.tabs.sessions import SessionsTab
from vgrd.page.tabs.teach import TeachTab

__all__ = ["CellTab", "ResultTab", "RuntimeTab", "SessionsTab", "TeachTab"]
