"""What is said of a picture that shows no tag, is dark, or has another size."""

from pathlib import Path

import numpy as np
import pytest

from vgrd.checking.sight import look_at
from vgrd.config.cell_file import CellConfig, load_config


@pytest.fixture
def config() -> CellConfig:
    config = load_config(Path(__file__).parents[3] / "config" / "cell.example.toml")
    small = {"matrix": [640.0, 640.0, 200.0, 150.0], "size_px": [400, 300]}
    return config.model_copy(update={"camera": config.camera.model_copy(update=small)})


@pytest.mark.parametrize(
    ("level", "words"), [(4, "dark (2 % of white): expose more"), (250, "bright (98 %")]
)
def test_an_empty_picture_is_told_with_what_is_wanted(config, level, words):
    told = look_at(np.full((300, 400), level, np.uint8), config).to_json()
    assert told["sees"] == ""
    assert told["tags"]["a"] == {"wanted": "36h11 id 0", "seen": False, "side_px": None}
    remarks = "\n".join(told["remarks"])
    assert "sees no tag; the cell file wants 36h11 id 0 as tag A" in remarks
    assert "sees no tag; the cell file wants 36h11 id 1 as tag B" in remarks
    assert words in remarks


def test_a_picture_of_another_size_is_told_with_the_key(config):
    told = look_at(np.full((400, 300), 128, np.uint8), config).to_json()
    assert told["remarks"][0] == (
        "the picture has 300 x 400 px, the cell file says 400 x 300: correct [camera] size_px and matrix"
    )
