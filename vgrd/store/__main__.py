"""python -m vgrd.store STATE_DIR: whether this version understands the calibration in use; its reason if not.

Asked before a version is put in use. One that is damaged is no reason: no version could use it.
"""

import sys
from pathlib import Path

from vgrd.errors import InputError, SchemaTooNew, StoreError
from vgrd.store.calibrations import CalibrationStore

if __name__ == "__main__":
    try:
        CalibrationStore(Path(sys.argv[1])).current()
    except SchemaTooNew as error:
        sys.exit(f"{error}")
    except (InputError, StoreError):
        pass
