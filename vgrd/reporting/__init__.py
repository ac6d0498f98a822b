"""One page about a session, to read and to print: verdict, error budget, noise, verifications, pictures, hashes.

May import solving and the store; nothing of the daemon.
"""

from vgrd.reporting.page import report_page
from vgrd.reporting.session import SessionReport, report_of, stored_result

__all__ = ["SessionReport", "report_of", "report_page", "stored_result"]
