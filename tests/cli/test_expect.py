"""`vgrd expect`: the error of a cell from its file alone, and what is wrong with the file or the options."""

import re
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "config" / "cell.example.toml"


@pytest.fixture(scope="module")
def text() -> str:
    return EXAMPLE.read_text()


def written(folder: Path, text: str, **keys: str) -> Path:
    """The example with some lines `key = ...` written otherwise, all of them."""
    for key, value in keys.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        assert count
    path = folder / "cell.toml"
    path.write_text(text)
    return path


def test_it_tells_errors_shares_changes_minutes_and_what_was_assumed(vgrd, tmp_path) -> None:
    out = tmp_path / "expected.json"
    result = vgrd("expect", EXAMPLE, "--json", "-").result
    assert [row["target"] for row in result["targets"]] == ["P1", "P2", "P3", "P4"]
    for row in result["targets"]:
        assert sum(row[link] for link in result["links"]) == pytest.approx(1)
        assert row["meets"] == (row["u95_mm"] <= result["max_u95_mm"])
    assert result["worst_u95_mm"] == max(row["u95_mm"] for row in result["targets"])
    assert result["minutes"]["all"] == pytest.approx(8 * 0.25 + 4 * 0.15 + 8 * 5 / 6)
    assert result["assumed"]["distance_mm"] == 700
    done = vgrd("expect", EXAMPLE, "--json", out)
    words = " ".join(done.out.split())
    for told in ("this cell can be expected to", "distance_mm 700", "operator minutes", "touches"):
        assert told in words


def test_a_limit_that_is_too_narrow_is_told_with_what_to_change_first(
    vgrd, tmp_path, text
) -> None:
    narrow = text.replace("[serving]", "[serving]\nmax_u95_mm = 0.2\nwarn_u95_mm = 0.1")
    result = vgrd("expect", written(tmp_path, narrow), "--json", "-").result
    assert not result["meets"]
    assert "cannot be expected to meet max_u95_mm 0.2 mm at P1, P2, P3, P4" in result["in_words"]
    first = min(result["changes"], key=lambda change: change["u95_mm"])
    assert first["words"] in result["in_words"]


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"lateral_sigma_mm": "-1.0"}, ("touch.lateral_sigma_mm",)),
        ({"matrix": "[6486.0, 6486.0, 2012.0]"}, ("camera.matrix", "four numbers")),
        ({"motion": '"round"'}, ("object.motion",)),
    ],
)
def test_a_bad_cell_file_is_refused_by_line_and_key(vgrd, tmp_path, text, keys, told) -> None:
    done = vgrd("expect", written(tmp_path, text, **keys))
    assert done.code != 0
    line = next(
        i for i, one in enumerate(text.splitlines(), 1) if one.startswith(next(iter(keys)))
    )
    for words in (f"line {line}: ", *told):
        assert words in done.err


def test_a_driver_that_is_not_known_yet_does_not_matter(vgrd, tmp_path, text) -> None:
    assert vgrd("expect", written(tmp_path, text, driver='"bought_later"'), "--json", "-").result


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--distance-mm", 0), "--distance-mm"),
        (("--tag-tilt-deg", 80), "--tag-tilt-deg"),
        (("--touches", 4, "--turned", 5), "--turned"),
        (("--corner-px", "nan"), "--corner-px"),
        (("--touches", 1), "touch"),
    ],
)
def test_options_that_cannot_be_are_refused_by_name(vgrd, words, told) -> None:
    done = vgrd("expect", EXAMPLE, *words)
    assert done.code != 0
    assert told in done.err


def test_a_missing_file_is_named(vgrd) -> None:
    done = vgrd("expect", "nowhere.toml")
    assert done.code != 0
    assert "nowhere.toml" in done.err
