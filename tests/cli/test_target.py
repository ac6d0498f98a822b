"""`vgrd target`: files that can be printed, and errors that help."""

import json

import cv2

from vgrd.vision.tags.detection import find_tags


def test_a_tag_is_drawn_as_asked_for_in_every_format(vgrd, tmp_path):
    for suffix, start in ((".pdf", b"%PDF"), (".svg", b"<svg"), (".png", b"\x89PNG")):
        out = tmp_path / f"tag{suffix}"
        done = vgrd(
            "target", "tag", "36h11", 4, "--size-mm", 25, "--dpi", 200, "--out", out, "--json", "-"
        )
        assert done.result["config"] == ['family = "36h11"', "id = 4", "size_mm = 25.0"]
        assert out.read_bytes().startswith(start)
    found = find_tags(cv2.imread(str(tmp_path / "tag.png"), 0), ["36h11"])
    assert [tag.id for tag in found] == [4]


def test_boards_are_drawn(vgrd, tmp_path):
    out, report = tmp_path / "grid.png", tmp_path / "grid.json"
    words = ("--tags", "3x2", "--size-mm", 30, "--dpi", 150, "--out", out, "--json", report)
    assert vgrd("target", "grid", "25h9", *words).code == 0
    assert len(find_tags(cv2.imread(str(out), 0), ["25h9"])) == 6
    assert "gap_mm = 7.5" in json.loads(report.read_text())["config"]
    words = ("--squares", "6x4", "--dictionary", "DICT_4X4_50", "--out", tmp_path / "c.pdf")
    assert vgrd("target", "charuco", *words).code == 0


def test_what_cannot_be_drawn_is_told_with_the_remedy(vgrd, tmp_path):
    out = tmp_path / "tag.pdf"
    for words, message in (
        (("tag", "36h11", 999, "--size-mm", 25), "ids 0 to 586"),
        (("tag", "36h99", 0, "--size-mm", 25), "known: 16h5"),
        (("tag", "36h11", 0, "--size-mm", 400), "choose a smaller size"),
        (("tag", "36h11", 0, "--size-mm", 0.025), "1 or more; in metres? 25 mm"),
        (("tag", "36h11", 0, "--size-mm", -25), "give the edge of the black square"),
        (("grid", "36h11", "--size-mm", 0.03), "a tag of 0.03 mm"),
        (("charuco", "--square-mm", 0.03, "--marker-mm", 0.022), "a square of 0.03 mm"),
        (("charuco", "--squares", "5"), "such as 5x7"),
        (("charuco", "--dictionary", "36h11"), "ChArUco boards have ArUco markers"),
        (("charuco", "--marker-mm", 40), "must be below square_mm"),
    ):
        done = vgrd("target", *words, "--out", out)
        assert done.code == 65
        assert message in done.err
        assert not out.exists()
