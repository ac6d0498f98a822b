"""`vgrd check --connect`: each device opened once, one after the other, in a process that can be killed."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgrd.config.cell_file import CellConfig
from vgrd.config.setup import ONE_THREAD
from vgrd.devices import Pixels
from vgrd.errors import DeviceError, DeviceUnavailable, device_error
from vgrd.orphans import dying_with_us

TIME_LIMIT_S = 30.0  # opening takes up to 5 s on a busy machine, reading 3: what is longer hangs


@dataclass(frozen=True, slots=True, eq=False)
class Connected:
    """What the devices said, by "robot", "camera", "pedal"; picture: None where none came.

    troubles: by the same names, why one could not be read.
    """

    told: Mapping[str, Mapping[str, object]]
    troubles: Mapping[str, DeviceError]
    picture: Pixels | None


def connect(config: CellConfig, time_limit_s: float = TIME_LIMIT_S) -> Connected:
    """Ask every device of the file; what is wrong with one keeps nobody from asking the next."""
    told: dict[str, Mapping[str, object]] = {}
    troubles: dict[str, DeviceError] = {}
    with tempfile.TemporaryDirectory(prefix="vgrd-check-") as folder:
        picture = Path(folder) / "picture.npy"
        for kind in ("robot", "camera", "pedal"):
            section = getattr(config, kind)
            if not section.driver:
                continue
            words = [kind, section.driver, json.dumps(section.settings), str(picture)]
            try:
                told[kind] = _ask(words, time_limit_s)
            except DeviceError as err:
                troubles[kind] = err
        pixels: Pixels | None = np.load(picture) if picture.exists() else None
    return Connected(told, troubles, pixels)


def _ask(words: list[str], time_limit_s: float) -> Mapping[str, object]:
    command = dying_with_us([sys.executable, "-m", "vgrd.checking.probe", *words])
    kind, driver = words[:2]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=time_limit_s,
            check=False,
            env={**os.environ, **ONE_THREAD},
        )
    except subprocess.TimeoutExpired as err:
        raise DeviceUnavailable(
            f"the {kind} said nothing within {time_limit_s:g} s: driver {driver} hangs; is the device on, the "
            "network's cable in?"
        ) from err
    lines = done.stdout.splitlines()
    if done.returncode != 0 or not lines:
        last = (done.stderr.strip().splitlines() or ["it left no word"])[-1]
        raise DeviceUnavailable(
            f"driver {driver} died with {done.returncode} when it opened the {kind}: {last}"
        )
    answer = json.loads(lines[-1])
    if "error" in answer:
        raise device_error(answer["error"], answer["message"])
    return dict(answer["told"])
