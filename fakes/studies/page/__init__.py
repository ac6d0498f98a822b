"""One page with each figure and table of the paper beside ours, made by running the studies.

May import the catalogue and what conducts a study.
"""

from fakes.studies.page.chapters import CHAPTERS, Chapter
from fakes.studies.page.html import page

__all__ = ["CHAPTERS", "Chapter", "page"]
