"""What is found on a machine: versions, the link, the cell file; and what cannot be used is named."""

import sys
from pathlib import Path

import pytest

from vgrd.errors import ConfigError, InputError
from vgrd.installing.__main__ import main
from vgrd.installing.looking import check_python, found_at, wish_of
from vgrd.installing.places import Places

PROJECT = Path(__file__).parents[2]


@pytest.fixture
def places(tmp_path: Path) -> Places:
    return Places(tmp_path)


def put_version(places: Places, name: str) -> None:
    (places.source(name) / "config").mkdir(parents=True)
    (places.source(name) / "config" / "vgrd.service").write_text(f"service of {name}")
    (places.source(name) / "config" / "vgrd.socket").write_text("socket")


def put_cell(places: Places, text: str) -> None:
    places.cell_file.parent.mkdir(parents=True)
    places.cell_file.write_text(text)


def wish(**more: object):
    settings = {"cell": None, "python": sys.executable, "extras": "cameras", "wheels": None}
    return wish_of(**{"source": PROJECT, **settings, **more})


def test_a_bare_machine(places) -> None:
    found = found_at(places)
    assert (found.versions, found.current, found.has_cell_file) == ({}, "", False)
    assert found.port == 1502
    assert found.state == places.state


def test_versions_and_the_one_in_use(places) -> None:
    for name in ("0.1-10", "0.1-9"):
        put_version(places, name)
    places.current.symlink_to("0.1-9")
    (places.versions / "0.2-11").mkdir()  # an installation broke off
    found = found_at(places)
    assert list(found.versions) == ["0.1-9", "0.1-10", "0.2-11"]
    assert found.current == "0.1-9"
    assert found.versions["0.1-9"].service == "service of 0.1-9"


def test_archives_of_versions_that_are_gone_are_found(places) -> None:
    assert found_at(places).archived == []
    places.backups.mkdir(parents=True)
    for name in ("before-0.1-10.tar", "before-0.1-9.tar", ".before-0.1-11.tar.tmp", "mine.tar"):
        (places.backups / name).touch()
    assert found_at(places).archived == ["0.1-9", "0.1-10"]


def test_a_link_that_leads_nowhere_is_none(places) -> None:
    put_version(places, "0.1-1")
    places.current.symlink_to("0.1-7")
    assert found_at(places).current == ""


def test_where_the_cell_file_says(places) -> None:
    put_cell(places, '[cell]\nstate_dir = "/data"\n[serving]\nhost = "10.0.0.1"\nport = 502\n')
    found = found_at(places)
    assert (found.host, found.port, found.state) == ("10.0.0.1", 502, Path("/data"))


def test_a_cell_file_that_is_no_toml_is_named(places) -> None:
    put_cell(places, "port = = 1")
    with pytest.raises(ConfigError, match=r"cell\.toml"):
        found_at(places)


def test_the_example_leaves_its_folders_to_the_unit() -> None:
    assert "state_dir" not in wish().cell_text
    assert wish().is_example


def test_the_users_cell_file_is_taken_as_it_is(tmp_path) -> None:
    (tmp_path / "mine.toml").write_text("mine")
    mine = wish(cell=tmp_path / "mine.toml")
    assert (mine.cell_text, mine.is_example) == ("mine", False)


@pytest.mark.parametrize("more", [{"cell": Path("nowhere.toml")}, {"source": Path("/usr")}])
def test_what_is_not_there_is_named(more) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        wish(**more)


def test_an_interpreter_must_be_one_that_the_service_sees(places, tmp_path) -> None:
    check_python(places, sys.executable)
    with pytest.raises(InputError, match="cannot be run"):
        check_python(places, "/nowhere/python3")
    old = tmp_path / "python"
    old.write_text("#!/bin/sh\necho 3 9\necho /usr\n")
    old.chmod(0o755)
    with pytest.raises(InputError, match=r"is 3\.9, 3\.11 is the oldest"):
        check_python(places, str(old))
    old.write_text("#!/bin/sh\necho 3 12\necho /root/.pyenv\n")
    with pytest.raises(InputError, match="/usr/bin/python3"):
        check_python(Places(Path("/")), str(old))


def test_a_dry_run_tells_all_and_does_nothing(tmp_path, capsys) -> None:
    main(["install", "--root", str(tmp_path), "--dry-run", "--python", sys.executable])
    told = capsys.readouterr().out
    for part in ("-m venv", "pip install", "constraints.txt", "link", "write"):
        assert part in told
    assert list(tmp_path.iterdir()) == []


def test_a_way_back_and_a_removal_on_a_machine_without_versions(tmp_path, capsys) -> None:
    with pytest.raises(InputError, match="no version before the one in use"):
        main(["install", "--rollback", "--root", str(tmp_path)])
    (tmp_path / "var/lib/vgrd").mkdir(parents=True)
    main(["uninstall", "--root", str(tmp_path)])
    assert "kept: " in capsys.readouterr().out
    assert (tmp_path / "var/lib/vgrd").exists()
    main(["uninstall", "--root", str(tmp_path), "--purge", "everything"])
    assert not (tmp_path / "var/lib/vgrd").exists()


@pytest.mark.parametrize("word", ["", "yes", "all"])
def test_all_goes_by_the_whole_word_only(tmp_path, word, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["uninstall", "--root", str(tmp_path), "--purge", word])
    assert "everything" in capsys.readouterr().err
