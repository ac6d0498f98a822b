"""Measures one module, as the child of `tests.benchmarks`: `... module NAME FOLDER FD`; a JSON line a row into FD."""

import importlib
import json
import os
import sys


def main(name: str, folder: str, fd: int) -> None:
    """Send every row as soon as it is known; the module is looked for in `folder` too."""
    sys.path.append(folder)
    with os.fdopen(fd, "w", encoding="utf-8", buffering=1) as rows:
        for row in importlib.import_module(name).rows():
            rows.write(json.dumps(row.as_message()) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
