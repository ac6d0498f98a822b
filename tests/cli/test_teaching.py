"""A person teaches, asks and activates with nothing but the command line, against a living daemon."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fakes.world.poses import WORK_ROTATION, look_poses
from vgrd.geometry import Pose
from vgrd.ipc.control import ControlClient
from vgrd.store.sessions import load_recording

pytestmark = pytest.mark.system
ATTEMPTS = 30
REPLY_TIMEOUT_S = 60.0  # of a command on a busy machine
# Words with which the daemon asks to try again: the machine is busy, or something still moves.
AGAIN = ("wait until", "no picture within", "is offline", "flange readings cover", "not serving")


def patiently(call):
    """The command's end, given again as long as the daemon asks for it."""
    for _ in range(ATTEMPTS - 1):
        done = call()
        if done.code == 0 or not any(words in done.err for words in AGAIN):
            return done
        time.sleep(0.5)
    return call()


@pytest.fixture
def ask(live, vgrd, monkeypatch):
    """Call `vgrd WORDS...` for the daemon of the live cell."""
    call = ControlClient.call
    monkeypatch.setattr(
        ControlClient,
        "call",
        lambda self, op, *, timeout_s, **given: call(
            self, op, timeout_s=max(timeout_s, REPLY_TIMEOUT_S), **given
        ),
    )
    return lambda *words: patiently(lambda: vgrd(*words, "--config", live.cell.fake.cell_file))


def stand(arrival_s: float) -> None:
    time.sleep(max(0.0, arrival_s - time.monotonic()) + 0.1)


def test_a_session_is_taught_sample_by_sample(live, ask) -> None:
    world = live.cell.world
    started = ask("record", "start", "--session", "by-hand", "--plan", "special", "--json", "-")
    folder = Path(started.result["folder"])
    assert ask("record", "start").code != 0

    look, second = look_poses(world.layout, 2)
    stand(world.move_flange(look, time.monotonic()))
    done = ask("look", "--json", "-").result
    assert done["have"] == {"look": 1}
    assert done["missing"] == {"look": 7, "spin": 4, "touch": 6}
    assert done["tags"] == ["tag_a", "tag_b"]
    stand(world.move_flange(second, time.monotonic()))
    assert "look" in ask("look").out
    assert ask("spin", "--json", "-").result["have"] == {"look": 2, "spin": 1}

    stand(world.jog_onto("P1", WORK_ROTATION, time.monotonic()))
    assert ask("touch", "P1", "--json", "-").result["have"]["touch"] == 1
    assert ask("touch", "P1", "--json", "-").result["have"]["touch"] == 2
    unknown = ask("touch", "P9")
    assert unknown.code != 0
    assert "'P9'" in unknown.err
    assert "P1, P2" in unknown.err
    undone = ask("undo", "--json", "-").result
    assert (undone["undone"], undone["have"]["touch"]) == ("touch", 1)
    assert ask("verify", "P1", "--json", "-").result["have"]["verify"] == 1
    assert ask("point", "spike", "--json", "-").result["have"]["point"] == 1

    recording = ask("status", "--json", "-").result["recording"]
    assert recording["session"] == "by-hand"
    assert recording["trouble"] == ""
    assert ask("record", "stop", "--json", "-").result["folder"] == str(folder)
    assert ask("look").code != 0

    taught = load_recording(folder)
    assert (len(taught.looks), len(taught.spins), len(taught.touches)) == (2, 1, 1)
    assert (len(taught.points), len(taught.verifications)) == (1, 1)
    again = ask("record", "start", "--session", "by-hand")
    assert again.code != 0
    assert "exists already" in again.err


def test_nothing_is_recorded_where_a_tag_is_hidden_or_no_session_is_open(live, ask) -> None:
    closed = ask("look")
    assert closed.code != 0
    assert "vgrd record start" in closed.err
    assert ask("record", "start", "--plan", "universall").code != 0
    ask("record", "start", "--session", "hidden", "--no-harvest")
    live.cell.world.cover("a")
    time.sleep(0.2)
    done = ask("look")
    assert done.code != 0
    assert "tag A" in done.err
    assert ask("record", "stop", "--json", "-").result["have"] == {}


def test_the_expected_coordinate_leads_the_tip_onto_the_target(live, ask) -> None:
    result = ask("ec", "P2", "--json", "-").result
    rotvec = np.radians(result["rotvec_deg"])
    pose = Pose.from_rotvec(rotvec, result["position_mm"])
    assert np.linalg.norm(live.cell.world.miss_at(pose, "P2", 0.0)) < 1.0
    assert result["calibration"] == live.cell.calibration
    assert "P2" in ask("ec", "P2", "--policy", "follow").out


def test_the_expected_coordinate_says_what_it_is_and_how_the_robot_writes_it(ask) -> None:
    result = ask("ec", "P2", "--for", "UR", "--json", "-").result
    assert result["pose"].startswith("base_from_wrist: the flange")
    numbers = [float(word) for word in result["for_ur"].strip("p[]").split(",")]
    assert np.allclose(numbers[:3], np.array(result["position_mm"]) / 1000, atol=1e-6)
    assert np.allclose(numbers[3:], np.radians(result["rotvec_deg"]), atol=1e-6)
    assert "for_kuka" in ask("ec", "P2", "--for", "kuka").out
    assert "there are: abb" in ask("ec", "P2", "--for", "kukka").err


def test_a_coordinate_beyond_a_limit_is_refused_in_words(ask) -> None:
    done = ask("ec", "P2", "--policy", "requested", "--work-rotvec-deg", "0 0 0")
    assert done.code != 0
    for words in ("the wrong side", "beyond the limit", "cone_deg", "STATUS 603"):
        assert words in done.err
    limits = ask("status", "--json", "-").result["limits"]
    assert "deg of the taught approach" in limits["cell"]


@pytest.mark.parametrize(
    ("words", "told"),
    [(("ec", "P9"), "P9"), (("ec", "P1", "--policy", "folow"), "choose one of")],
)
def test_what_cannot_be_computed_is_refused_by_name(ask, words, told) -> None:
    done = ask(*words)
    assert done.code != 0
    assert told in done.err


def test_a_calibration_with_a_flipped_bit_is_refused_and_the_active_one_serves_on(
    live, ask
) -> None:
    store = live.cell.state / "calibrations"
    good = store / f"{live.cell.calibration}.json"
    damaged = bytearray(good.read_bytes().replace(b"cal-000001", b"cal-000009"))
    damaged[len(damaged) // 2] ^= 4
    (store / "cal-000009.json").write_bytes(damaged)
    current = (store / "CURRENT").read_bytes()
    done = ask("activate", "cal-000009")
    (store / "cal-000009.json").unlink()
    assert done.code != 0
    assert "cal-000009.json" in done.err
    assert "restore it from a backup or solve its session again" in done.err
    assert (store / "CURRENT").read_bytes() == current
    assert ask("status", "--json", "-").result["calibration"] == live.cell.calibration
    missing = ask("activate", "cal-000077")
    assert missing.code != 0
    assert live.cell.calibration in missing.err
    again = ask("activate", live.cell.calibration, "--json", "-").result
    assert again["calibration"] == live.cell.calibration


def test_a_session_with_too_little_in_it_is_not_solved_and_nothing_changes(live, ask) -> None:
    ask("record", "start", "--session", "too-little")
    ask("record", "stop")
    done = ask("solve", "--json", "-")
    assert done.code != 0
    assert done.out == ""
    assert "touch at least" in done.err
    assert ask("status", "--json", "-").result["calibration"] == live.cell.calibration


def test_status_is_one_table_or_one_json(live, ask) -> None:
    def status_when_good() -> dict[str, object]:
        live.daemon.wait_until(lambda status: bool(status["serving"]))
        return ask("status", "--json", "-").result

    tries = (status_when_good() for _ in range(ATTEMPTS))
    status = next(found for found in tries if found["serving"])
    assert (status["robot"], status["camera"]) == ("ok", "ok")
    assert set(status["processes"]) == {"robot", "camera", "cell"}
    assert "serving" in ask("status").out
    assert ask("confirm", "--json", "-").result == {"confirmed": True, "fault": None}


def test_the_socket_serves_as_well_as_the_cell_file(live, vgrd, monkeypatch) -> None:
    path = live.daemon.runtime / "control.sock"
    status = vgrd("status", "--socket", path, "--json", "-").result
    assert status["calibration"] == live.cell.calibration
    monkeypatch.setenv("VGRD_CONFIG", str(live.cell.fake.cell_file))
    assert vgrd("status", "--json", "-").result["calibration"] == live.cell.calibration


def test_the_installed_command_is_the_same(live) -> None:
    command = Path(sys.executable).with_name("vgrd")
    done = subprocess.run(
        [command, "status", "--config", live.cell.fake.cell_file, "--json", "-"],
        capture_output=True,
        text=True,
        timeout=REPLY_TIMEOUT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["calibration"] == live.cell.calibration
