"""A file that is not there is named as what was asked for."""

import pytest


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (("check", "FILE"), "a cell file, see config/"),
        (("run", "FILE"), "a cell file, see config/"),
        (("solve", "FILE"), "a DATASET.toml"),
        (("tcp", "FILE"), "a file of touches (.toml)"),
        (("intrinsics", ".", "--board", "FILE"), "a board file (.toml)"),
        (("detect", "a.png", "--camera", "a.toml", "--board", "FILE"), "a board file (.toml)"),
    ],
)
def test_the_kind_of_the_missing_file_is_told(vgrd, tmp_path, words, kind) -> None:
    path = tmp_path / "missing.toml"
    done = vgrd(*(path if word == "FILE" else word for word in words))
    assert done.code == 78
    fault = f"no such file: give the path of {kind}"
    assert fault in " ".join(done.err.split())
    assert str(path) in done.err
