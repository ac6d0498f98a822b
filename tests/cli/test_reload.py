"""A reload that must not be is refused before anything is written, with the reason and the remedy."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from fakes.cell.rehearsal import facts_of
from fakes.world.layout import Layout
from fakes.world.samples import Samples
from fakes.world.world import CellNoise, World
from vgrd.commands import reloading
from vgrd.config.cell_file import load_config
from vgrd.config.resolved import Resolved, changed_keys
from vgrd.config.setup import cell_facts
from vgrd.errors import CalibrationMismatch, DaemonUnreachable, InputError
from vgrd.model import Verdict
from vgrd.store.calibrations import CalibrationStore


@pytest.fixture
def checked(tmp_path: Path) -> Resolved:
    facts_of(World(Layout(), 5, CellNoise.none()), tmp_path)
    path = tmp_path / "cell.toml"
    return Resolved(load_config(path), str(path), 1.0)


def with_key(resolved: Resolved, section: str, **values: object) -> Resolved:
    part = getattr(resolved.config, section).model_copy(update=values)
    return replace(resolved, config=resolved.config.model_copy(update={section: part}))


@pytest.mark.parametrize(
    ("section", "values", "key"),
    [
        ("serving", {"port": 1503}, "serving.port"),
        ("serving", {"host": "127.0.0.9"}, "serving.host"),
        ("cell", {"state_dir": "/elsewhere"}, "cell.state_dir"),
    ],
)
def test_what_needs_a_restart_is_named(
    checked: Resolved, section: str, values: Mapping[str, object], key: str
) -> None:
    changed = changed_keys(checked, with_key(checked, section, **values))
    assert changed == [key]
    with pytest.raises(InputError, match=f"{key} changed: that needs a restart"):
        reloading._refuse_what_needs_a_restart(Path("cell.toml"), changed)
    reloading._refuse_what_needs_a_restart(Path("cell.toml"), ["serving.max_age_s"])


def test_a_calibration_in_use_that_no_longer_fits_is_named_with_the_way_out(
    checked: Resolved,
) -> None:
    store = CalibrationStore(Path(checked.config.cell.state_dir))
    reloading._refuse_a_calibration_that_does_not_fit(checked)  # there is none
    fitting = replace(
        Samples(1).calibration(), facts=cell_facts(checked.config), verdict=Verdict()
    )
    store.activate(store.save(fitting))
    reloading._refuse_a_calibration_that_does_not_fit(checked)
    with pytest.raises(CalibrationMismatch, match=r"tool\.name was pin, is other.*--without-cal"):
        reloading._refuse_a_calibration_that_does_not_fit(with_key(checked, "tool", name="other"))
    (store.path / "CURRENT").write_bytes(b"torn")
    reloading._refuse_a_calibration_that_does_not_fit(checked)  # it serves nothing as it is


class Cell:
    """What the control socket answers."""

    def __init__(self, session: str | None) -> None:
        self.session = session

    def call(self, op: str) -> dict[str, object]:
        assert op == "status"
        if self.session == "gone":
            raise DaemonUnreachable("no answer")
        return {"recording": {"session": self.session}}


def test_a_session_that_is_being_recorded_is_not_cut_short() -> None:
    with pytest.raises(InputError, match="session monday is being recorded: stop it first"):
        reloading._refuse_while_recording(Cell("monday"))  # type: ignore[arg-type]
    reloading._refuse_while_recording(Cell(None))  # type: ignore[arg-type]
    reloading._refuse_while_recording(Cell("gone"))  # type: ignore[arg-type]


def test_a_file_that_was_broken_since_is_told_and_one_that_differs_is_named(
    checked: Resolved,
) -> None:
    assert reloading.file_now(checked) == "in force"
    path = Path(checked.source)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[serving]\n", "[serving]\nmax_age_s = 30.0\n"), encoding="utf-8")
    assert "not in force: serving.max_age_s" in reloading.file_now(checked)
    path.write_text("[[", encoding="utf-8")
    assert "cannot be used as it is now" in reloading.file_now(checked)
    path.unlink()
    assert "no such file" in reloading.file_now(checked)
