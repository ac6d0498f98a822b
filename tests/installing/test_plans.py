"""The plan of an installation, as data: what runs is touched last, and there is a way back."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vgrd.errors import InputError
from vgrd.installing.places import Places
from vgrd.installing.plans import (
    Found,
    Plan,
    Units,
    Wish,
    in_order,
    installation,
    next_version,
    number_of,
    removal,
    rollback,
)
from vgrd.installing.steps import Answer, Command, File, Flush, Link, Removal, Step

MACHINE = Places(Path("/"))
UNITS = Units("ExecStart=@VENV@/bin/vgrd run @CELL@\n", "ListenStream=@HOST@:@PORT@\n")
WISH = Wish(
    source=Path("/src"),
    version="0.2",
    units=UNITS,
    cell_text="[cell]\n",
    is_example=False,
    python="/usr/bin/python3",
    extras="cameras",
)
RUNNING = Found(
    versions={"0.1-1": UNITS, "0.1-2": UNITS},
    current="0.1-2",
    has_cell_file=True,
    is_running=True,
    has_service=True,
)
VERSIONS = st.lists(
    st.builds("{}-{}".format, st.sampled_from(("0.1.0", "0.2", "1.0rc1")), st.integers(1, 99)),
    max_size=8,
)


def words(steps: tuple[Step, ...]) -> list[str]:
    return [" ".join(step.argv) for step in steps if isinstance(step, Command)]


def of_systemd(plan: Plan) -> list[str]:
    return [word for word in words(plan.switch) if word.startswith("systemctl")]


@given(VERSIONS)
def test_a_new_version_comes_after_all_others(versions: list[str]) -> None:
    new = next_version("0.3", versions)
    assert in_order([*versions, new])[-1] == new
    assert number_of(new) > max(map(number_of, versions), default=0)


@given(VERSIONS, VERSIONS)
def test_no_update_has_the_archive_of_another_one(
    versions: list[str], archived: list[str]
) -> None:
    found = replace(RUNNING, versions={**RUNNING.versions, **dict.fromkeys(versions, UNITS)})
    plan = installation(MACHINE, WISH, replace(found, archived=archived))
    new = next(step.to.name for step in plan.switch if isinstance(step, Link))
    assert number_of(new) > max(map(number_of, archived), default=0)
    (backup,) = [word for word in words(plan.prepare) if "vgrd backup" in word]
    assert str(MACHINE.archive(new)) in backup


@pytest.mark.parametrize(
    "name", ["current", "-1", "0.1-", "0.1-01", "0.1-0", ".0.1-1.new", "0.1/x-1"]
)
def test_what_is_no_version_has_no_number(name: str) -> None:
    assert number_of(name) == 0


def test_what_runs_is_touched_when_the_new_version_is_whole() -> None:
    plan = installation(MACHINE, WISH, RUNNING)
    assert not [word for word in words(plan.prepare) if word.startswith("systemctl")]
    touched = {step.path for step in plan.prepare if isinstance(step, File | Link)}
    assert touched == {MACHINE.cell_file, MACHINE.sysusers}
    new = MACHINE.version("0.2-3")
    prepared = words(plan.prepare)
    order = ("-m venv", "pip install", "vgrd check", "-m vgrd.store", "vgrd backup")
    places = [next(i for i, w in enumerate(prepared) if part in w) for part in order]
    assert places == sorted(places)
    links = [step.to for step in plan.switch if isinstance(step, Link)]
    assert links[0] == new


def test_it_is_started_anew_after_the_link_and_must_answer() -> None:
    switch = installation(MACHINE, WISH, RUNNING).switch
    link = next(i for i, step in enumerate(switch) if isinstance(step, Link))
    restart = next(
        i for i, s in enumerate(switch) if isinstance(s, Command) and "restart" in s.argv
    )
    assert link < restart < len(switch) - 1
    assert switch[-1] == Answer(Path("/run/vgrd/control.sock"))


def test_a_switch_that_fails_goes_back_and_drops_the_new_version() -> None:
    plan = installation(MACHINE, WISH, RUNNING)
    assert Link(MACHINE.current, MACHINE.version("0.1-2")) in plan.back
    assert "systemctl restart vgrd.service" in words(plan.back)
    assert plan.back[-1] == plan.discard[0] == Removal(MACHINE.version("0.2-3"))


def test_the_version_before_is_kept_and_older_ones_go() -> None:
    plan = installation(MACHINE, WISH, RUNNING)
    assert plan.tidy == (Removal(MACHINE.version("0.1-1")),)


def test_a_service_that_was_stopped_stays_stopped() -> None:
    plan = installation(MACHINE, WISH, replace(RUNNING, is_running=False))
    assert not [word for word in of_systemd(plan) if "start" in word]


@pytest.mark.parametrize(("is_example", "starts"), [(True, False), (False, True)])
def test_a_first_installation_starts_with_a_cell_file_of_the_users_only(
    is_example: bool, starts: bool
) -> None:
    plan = installation(MACHINE, replace(WISH, is_example=is_example), Found())
    assert ("systemctl restart vgrd.service" in of_systemd(plan)) == starts
    assert any("vgrd check" in word for word in words(plan.prepare)) == starts
    assert "systemctl enable vgrd.service" in of_systemd(plan)
    assert plan.back == ()
    assert not any("backup" in word for word in words(plan.prepare))


@pytest.mark.parametrize("current", ["", "0.1-2"])
def test_a_cell_file_that_is_there_stays(current: str) -> None:
    plan = installation(MACHINE, WISH, replace(RUNNING, current=current))
    (cell,) = [
        step for step in plan.prepare if isinstance(step, File) and step.path.suffix == ".toml"
    ]
    assert cell.keep


def test_a_port_below_1024_is_opened_by_systemd_where_the_cell_file_says() -> None:
    found = replace(RUNNING, host="192.168.1.5", port=502)
    plan = installation(MACHINE, WISH, found)
    (unit,) = [s for s in plan.switch if isinstance(s, File) and s.path.name == "vgrd.socket"]
    assert unit.text == "ListenStream=192.168.1.5:502\n"
    assert of_systemd(plan) == [
        "systemctl daemon-reload",
        "systemctl enable vgrd.service vgrd.socket",
        "systemctl stop vgrd.service",
        "systemctl restart vgrd.socket",
        "systemctl restart vgrd.service",
    ]
    same = installation(MACHINE, WISH, replace(found, socket=unit.text))
    assert "systemctl restart vgrd.socket" not in of_systemd(same)  # robots that wait are kept


def test_a_socket_that_is_not_needed_any_more_goes() -> None:
    plan = installation(MACHINE, WISH, replace(RUNNING, socket="ListenStream=1.2.3.4:502\n"))
    assert of_systemd(plan)[0] == "systemctl disable --now vgrd.socket"
    assert Removal(MACHINE.units / "vgrd.socket") in plan.switch


def test_the_service_runs_what_the_link_leads_to() -> None:
    plan = installation(MACHINE, WISH, RUNNING)
    (unit,) = [s for s in plan.switch if isinstance(s, File) and s.path.name == "vgrd.service"]
    assert unit.text == "ExecStart=/opt/vgrd/current/bin/vgrd run /etc/vgrd/cell.toml\n"


def test_a_trial_does_nothing_outside_its_folder() -> None:
    places = Places(Path("/trial"))
    found = replace(RUNNING, socket="x", port=502, state=places.state)
    for plan in (
        installation(places, WISH, found),
        rollback(places, found),
        removal(places, found, purge=True),
    ):
        for step in (*plan.prepare, *plan.switch, *plan.tidy, *plan.back, *plan.discard):
            assert not isinstance(step, Answer)
            if isinstance(step, Command):
                assert step.argv[0] == WISH.python or step.argv[0].startswith("/trial/")
            else:
                assert isinstance(step, Flush) or step.path.is_relative_to("/trial")


def test_rolling_back_takes_the_version_before_or_the_one_that_is_named() -> None:
    found = replace(RUNNING, versions={f"0.1-{n}": UNITS for n in (1, 9, 10)}, current="0.1-10")
    assert Link(MACHINE.current, MACHINE.version("0.1-9")) in rollback(MACHINE, found).switch
    back = rollback(MACHINE, found, "0.1-1")
    assert Link(MACHINE.current, MACHINE.version("0.1-1")) in back.switch
    assert Link(MACHINE.current, MACHINE.version("0.1-10")) in back.back
    asked = f"{MACHINE.version('0.1-1')}/bin/python -m vgrd.store {found.state}"
    assert asked in words(back.prepare)  # whether it understands the calibration in use


@pytest.mark.parametrize("wanted", ["", "0.1-7", "../../home", "0.1-1"])
def test_there_is_no_way_back_to_what_is_not_there(wanted: str) -> None:
    with pytest.raises(InputError, match=r"beside the one in use there are: none"):
        rollback(MACHINE, replace(RUNNING, versions={"0.1-1": UNITS}, current="0.1-1"), wanted)


def test_a_state_folder_of_the_users_choice_is_not_ours_to_remove() -> None:
    found = replace(RUNNING, state=Path("/srv"))
    assert Path("/srv") not in removed(removal(MACHINE, found, purge=True))


def removed(plan: Plan) -> set[Path]:
    return {step.path for step in plan.switch if isinstance(step, Removal)}


def test_uninstalling_keeps_what_cannot_be_had_again() -> None:
    data = {RUNNING.state, MACHINE.backups, MACHINE.cell_file.parent, MACHINE.drop_ins}
    plan = removal(MACHINE, RUNNING, purge=False)
    assert not removed(plan) & data
    assert of_systemd(plan)[0] == "systemctl disable --now vgrd.service"
    assert plan.switch[-1] == Removal(MACHINE.versions)  # what runs this
    assert removed(removal(MACHINE, RUNNING, purge=True)) == removed(plan) | data


def test_a_removal_that_broke_off_can_be_repeated() -> None:
    """What is gone cannot be disabled: systemctl refuses it."""
    left = replace(RUNNING, has_service=False, socket="")
    assert of_systemd(removal(MACHINE, left, purge=False)) == ["systemctl daemon-reload"]
    left = replace(RUNNING, has_service=False, socket="x")
    assert of_systemd(removal(MACHINE, left, purge=False))[0].endswith("--now vgrd.socket")


def test_a_new_version_is_on_the_disk_before_it_is_in_use() -> None:
    assert installation(MACHINE, WISH, RUNNING).prepare[-1] == Flush()
