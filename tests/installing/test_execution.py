"""Steps of an installation on a real file system: whole or not at all, and told by name where they fail."""

import socket
import stat
import sys
from pathlib import Path

import pytest

from vgrd.errors import InputError, StepFailed
from vgrd.installing.execution import alone, carry_out, show
from vgrd.installing.plans import Plan
from vgrd.installing.steps import Answer, Command, Copy, File, Folder, Link, Removal


@pytest.fixture
def told() -> list[str]:
    return []


def python(code: str, *, remedy: str = "") -> Command:
    return Command((sys.executable, "-c", code), remedy=remedy)


FAILS = python("import sys; sys.exit('no index')", remedy="look at the network")


def test_steps_do_what_they_say(tmp_path, told) -> None:
    (tmp_path / "source" / "__pycache__").mkdir(parents=True)
    (tmp_path / "source" / "a.py").write_text("a")
    plan = Plan(
        prepare=(
            Folder(tmp_path / "new" / "folder"),
            File(tmp_path / "etc" / "cell.toml", "port = 1\n", mode=0o640),
            Copy(tmp_path / "source", tmp_path / "copy", ("__pycache__",)),
        ),
        switch=(Link(tmp_path / "opt" / "current", tmp_path / "new"),),
        tidy=(Removal(tmp_path / "source"), Removal(tmp_path / "never")),
    )
    carry_out(plan, told.append)
    assert (tmp_path / "etc" / "cell.toml").read_text() == "port = 1\n"
    assert stat.S_IMODE((tmp_path / "etc" / "cell.toml").stat().st_mode) == 0o640
    assert [path.name for path in (tmp_path / "copy").iterdir()] == ["a.py"]
    assert (tmp_path / "opt" / "current").readlink() == Path("../new")
    assert not (tmp_path / "source").exists()
    assert told == [str(step) for step in (*plan.prepare, *plan.switch, *plan.tidy)]


def test_telling_a_plan_does_nothing(tmp_path, told) -> None:
    show(Plan(prepare=(Folder(tmp_path / "a"),), switch=(FAILS,)), told.append)
    assert told[0] == f"would make folder {tmp_path / 'a'}"
    assert list(tmp_path.iterdir()) == []


def test_a_file_to_be_kept_is_kept(tmp_path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text("mine")
    File(path, "yours", keep=True).perform()
    assert path.read_text() == "mine"
    File(path, "yours").perform()
    assert path.read_text() == "yours"
    assert [entry.name for entry in tmp_path.iterdir()] == ["cell.toml"]


def test_a_preparation_that_fails_is_told_and_what_it_made_is_dropped(tmp_path, told) -> None:
    (tmp_path / "old").mkdir()
    Link(tmp_path / "current", tmp_path / "old").perform()
    plan = Plan(
        prepare=(Folder(tmp_path / "new"), FAILS),
        switch=(Link(tmp_path / "current", tmp_path / "new"),),
        discard=(Removal(tmp_path / "new"),),
    )
    with pytest.raises(StepFailed) as caught:
        carry_out(plan, told.append)
    for part in ("could not run", "ended with 1", "no index", "look at the network", "Nothing"):
        assert part in str(caught.value)
    assert (tmp_path / "current").readlink() == Path("old")
    assert not (tmp_path / "new").exists()


def test_a_switch_that_fails_goes_back_whatever_else_fails(tmp_path, told) -> None:
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
    Link(tmp_path / "current", tmp_path / "old").perform()
    plan = Plan(
        switch=(Link(tmp_path / "current", tmp_path / "new"), FAILS),
        back=(FAILS, Link(tmp_path / "current", tmp_path / "old")),
        tidy=(Removal(tmp_path / "old"),),
    )
    with pytest.raises(StepFailed, match="The version before is in use again"):
        carry_out(plan, told.append)
    assert (tmp_path / "current").readlink() == Path("old")
    assert (tmp_path / "old").exists()


def test_at_any_moment_a_link_leads_to_the_old_or_to_the_new(tmp_path) -> None:
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
    link = tmp_path / "current"
    Link(link, tmp_path / "old").perform()
    (tmp_path / ".current.new").symlink_to("nowhere")  # a kill left it
    Link(link, tmp_path / "new").perform()
    assert link.resolve() == tmp_path / "new"
    link.unlink()
    link.mkdir()
    with pytest.raises(OSError, match="directory"):
        Link(link, tmp_path / "new").perform()


def test_a_link_is_removed_and_not_what_it_leads_to(tmp_path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "link").symlink_to("data")
    Removal(tmp_path / "link").perform()
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_commands_run_what_is_installed_and_not_what_lies_around(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "strayed.py").write_text("")
    with pytest.raises(StepFailed, match="No module named 'strayed'"):
        python("import strayed").perform()


def test_a_command_that_is_not_there_is_told(told) -> None:
    with pytest.raises(StepFailed, match=r"could not run /nowhere/systemctl: .*No such file"):
        carry_out(Plan(prepare=(Command(("/nowhere/systemctl",)),)), told.append)


def test_an_answer_is_waited_for(tmp_path) -> None:
    path = tmp_path / "control.sock"
    with pytest.raises(StepFailed, match="no answer within 0 s: No such file"):
        Answer(path, within_s=0).perform()
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        listening.listen()
        Answer(path, within_s=0).perform()


def test_two_installations_do_not_work_at_once(tmp_path) -> None:
    with (
        alone(tmp_path / "opt"),
        pytest.raises(InputError, match="another installation"),
        alone(tmp_path / "opt"),
    ):
        pass
    with alone(tmp_path / "opt"):
        pass
