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
    png = tmp_path / "expected.png"
    done = vgrd("expect", EXAMPLE, "--json", out, "--png", png)
    assert png.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
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


def test_targets_without_cad_lie_on_a_circle_and_are_all_touched(vgrd, tmp_path, text) -> None:
    bare = re.sub(r"(?m)^(point_mm|center_mm) = .*$", "", text)
    path = written(tmp_path, bare, policy='"follow"')
    words = ("--radius-mm", 60, "--four-axes")
    result = vgrd("expect", path, *words, "--json", "-").result
    assert result["policy"] == "follow"
    assert result["assumed"]["touches"] == 4 + 3 + 2
    assert result["tag_a_hidden_u95_mm"] > result["worst_u95_mm"]
    done = vgrd("expect", path, "--touches", 8)
    assert done.code != 0
    assert "give 9 touches or more" in " ".join(done.err.split())


def test_a_camera_that_people_move_has_no_answer_without_tag_a(vgrd, tmp_path, text) -> None:
    path = written(tmp_path, text.replace("bits = 8", ""), rate_hz='2.0\nstability = "movable"')
    result = vgrd("expect", path, "--json", "-").result
    assert result["tag_a_hidden_u95_mm"] is None
    assert result["assumed"]["looks"] == result["assumed"]["turned"] == 0


def test_a_scene_that_does_not_fit_the_picture_is_remarked(vgrd) -> None:
    near = vgrd("expect", EXAMPLE, "--distance-mm", 450, "--tag-b-mm", 150, "--json", "-").result
    assert any("leaves the picture" in remark for remark in near["remarks"])
    far = vgrd("expect", EXAMPLE, "--distance-mm", 6000, "--json", "-").result
    assert any("larger tag" in remark for remark in far["remarks"])
    assert not vgrd("expect", EXAMPLE, "--json", "-").result["remarks"]


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
        (("--distance-mm", 200), "give a larger --distance-mm"),
        (("--tag-tilt-deg", 80), "--tag-tilt-deg"),
        (("--touches", 4, "--turned", 5), "--turned"),
        (("--corner-px", "nan"), "--corner-px"),
        (("--touches", 1), "touch"),
    ],
)
def test_options_that_cannot_be_are_refused_by_name(vgrd, words, told) -> None:
    done = vgrd("expect", EXAMPLE, *words)
    assert done.code != 0
    assert told in " ".join(done.err.split())


def test_a_missing_file_is_named(vgrd) -> None:
    done = vgrd("expect", "nowhere.toml")
    assert done.code != 0
    assert "nowhere.toml" in done.err
