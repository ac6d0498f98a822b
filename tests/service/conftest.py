"""What the tests of the service share: a world that hurries, and hot loops compiled once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fakes.cell.operator import SPEED_MM_S, TURN_RAD_S
from fakes.world.layout import Layout
from fakes.world.world import World

SEED = 1


@pytest.fixture
def world() -> World:
    return World(Layout(), SEED, speed_mm_s=SPEED_MM_S, turn_rad_s=TURN_RAD_S)


@pytest.fixture(scope="session")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache as the unit has it after its first start."""
    cache = tmp_path_factory.mktemp("cache")
    env = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    subprocess.run([sys.executable, "-m", "vgrd.vision"], env=env, check=True, timeout=400)
    return cache
