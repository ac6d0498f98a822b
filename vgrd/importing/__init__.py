"""What users bring, looked at and written as a DATASET.toml: nothing is asked, every assumption is told.

May import documents, geometry, calibration, vision and model.
"""

from vgrd.importing.importing import Imported, import_files

__all__ = ["Imported", "import_files"]
