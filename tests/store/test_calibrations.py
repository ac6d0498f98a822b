"""Calibrations are whole or not there, and the one in use is the one that was activated."""

import hashlib
import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from fakes.testing import ManualClock
from fakes.world.samples import Samples
from vgrd.errors import Corrupt, InputError, NoCurrentCalibration, SchemaTooNew, StoreError
from vgrd.orphans import dying_with_us
from vgrd.store.calibrations import SCHEMA, ActivationRecord, CalibrationStore
from vgrd.store.encoding import encode
from vgrd.store.files import read_document, write_document


@pytest.fixture
def store(tmp_path):
    return CalibrationStore(tmp_path, ManualClock(wall_s=1.7e9))


@pytest.mark.parametrize("seed", range(3))
def test_a_calibration_comes_back_exactly_under_its_new_id(store, seed):
    calibration = Samples(seed).calibration()
    name = store.save(calibration)
    loaded = store.load(name)
    assert loaded.id == name == "cal-000001"
    assert encode(loaded) == encode(calibration) | {"id": name}


def test_numbers_go_up_and_files_are_never_overwritten(store):
    names = [store.save(Samples(seed).calibration()) for seed in range(3)]
    assert names == ["cal-000001", "cal-000002", "cal-000003"]
    assert store.list() == tuple(names)
    with ThreadPoolExecutor(4) as pool:
        more = list(pool.map(lambda i: store.save(Samples(i).calibration()), range(8)))
    assert sorted(more) == [f"cal-{i:06d}" for i in range(4, 12)]


def test_the_number_for_robots_is_the_start_of_the_checksum_in_the_file(store):
    name = store.save(Samples(1).calibration())
    sealed = json.loads((store.path / f"{name}.json").read_bytes())
    seal = {"body": sealed["body"], "schema": sealed["schema"]}
    digest = hashlib.sha256(
        json.dumps(seal, sort_keys=True, separators=(",", ":")).encode()
    ).digest()
    assert sealed["sha256"] == digest.hex()
    assert store.read(name).register_id == int.from_bytes(digest[:4], "big")


def test_nothing_is_in_use_before_the_first_activation(store):
    with pytest.raises(NoCurrentCalibration, match="vgrd activate"):
        store.current()
    store.save(Samples(1).calibration())
    with pytest.raises(NoCurrentCalibration):
        store.current_id()


def test_activations_are_logged_and_can_be_taken_back(store):
    for seed in range(2):
        store.save(Samples(seed).calibration())
    assert store.activate("cal-000001", by="anna").id == "cal-000001"
    store.activate("cal-000002", by="bert")
    assert store.current().id == "cal-000002"
    store.activate("cal-000001", by="bert")
    assert store.current_id() == "cal-000001"
    assert store.activations() == (
        ActivationRecord("cal-000001", "", "anna", 1.7e9),
        ActivationRecord("cal-000002", "cal-000001", "bert", 1.7e9),
        ActivationRecord("cal-000001", "cal-000002", "bert", 1.7e9),
    )


@pytest.mark.parametrize("name", ["cal-000002", "cal-1", "../cal-000001", ""])
def test_an_unknown_calibration_is_refused_and_changes_nothing(store, name):
    store.activate(store.save(Samples(1).calibration()))
    with pytest.raises(InputError, match="calibration"):
        store.activate(name)
    assert store.current().id == "cal-000001"
    assert len(store.activations()) == 1


@pytest.mark.parametrize("file", ["cal-000001.json", "CURRENT"])
def test_any_flipped_bit_is_corrupt_naming_file_and_remedy(store, file):
    store.activate(store.save(Samples(1).calibration()))
    store.save(Samples(2).calibration())
    path = store.path / file
    whole = path.read_bytes()
    rng = np.random.default_rng(4)
    for _ in range(300):
        flipped = bytearray(whole)
        flipped[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        with pytest.raises(Corrupt, match=rf"{file}.*(activate|restore)"):
            store.current()
    path.write_bytes(whole)
    assert store.current().id == "cal-000001"


@pytest.mark.parametrize("file", ["cal-000002.json", "CURRENT"])
def test_a_file_cut_anywhere_is_corrupt(store, file):
    for seed in range(2):
        store.activate(store.save(Samples(seed).calibration()))
    path = store.path / file
    whole = path.read_bytes()
    for cut in np.linspace(0, len(whole) - 1, 50, dtype=int):
        path.write_bytes(whole[:cut])
        with pytest.raises(Corrupt, match=file):
            store.current()


def test_a_damaged_calibration_offers_the_previous_one_and_does_not_take_it(store):
    for seed in range(2):
        store.activate(store.save(Samples(seed).calibration()))
    (store.path / "cal-000002.json").write_bytes(b"{}")
    with pytest.raises(Corrupt, match=r"cal-000002\.json.*activate cal-000001"):
        store.current()
    assert store.activate("cal-000001").id == store.current().id == "cal-000001"


def test_a_calibration_that_was_replaced_or_removed_behind_its_back_is_refused(store):
    for seed in range(2):
        store.save(Samples(seed).calibration())
    store.activate("cal-000001")
    path = store.path / "cal-000001.json"
    forged = read_document(path, SCHEMA) | {"session": "another"}
    write_document(path, forged, SCHEMA)
    with pytest.raises(Corrupt, match="not the file that was activated"):
        store.current()
    (store.path / "cal-000002.json").replace(path)
    with pytest.raises(Corrupt, match="holds cal-000002"):
        store.current()
    path.unlink()
    with pytest.raises(Corrupt, match="no calibration 'cal-000001'"):
        store.current()


def test_a_newer_schema_is_told_apart_from_damage(store):
    name = store.save(Samples(1).calibration())
    path = store.path / f"{name}.json"
    write_document(path, read_document(path, SCHEMA) | {"joint_zero": []}, SCHEMA + 1)
    with pytest.raises(SchemaTooNew, match=r"cal-000001\.json: schema \d+.*update vgrd"):
        store.load(name)


def test_a_key_of_another_version_is_named(store):
    name = store.save(Samples(1).calibration())
    path = store.path / f"{name}.json"
    write_document(path, read_document(path, SCHEMA) | {"joint_zero": []}, SCHEMA)
    with pytest.raises(Corrupt, match=r"cal-000001\.json: unknown key 'joint_zero'"):
        store.load(name)


def test_a_folder_that_cannot_be_written_is_named_and_the_old_one_stays_in_use(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match=r"cannot write into .*calibrations.*a part of it is a"):
        CalibrationStore(tmp_path / "file").save(Samples(1).calibration())


def test_kills_never_leave_half_a_calibration(tmp_path):
    script = Path(__file__).with_name("killing.py")
    result = subprocess.run(
        dying_with_us([sys.executable, str(script), "saver", str(tmp_path), "20"]),
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_calibration_activated_by_an_older_version_stays_in_use(store):
    text = (Path(__file__).parent / "schema_1" / "joint.json").read_text()
    name, sealed = json.loads(text)["body"]["id"], json.loads(text)["sha256"]
    store.path.mkdir(parents=True, exist_ok=True)
    (store.path / f"{name}.json").write_text(text)
    write_document(store.path / "CURRENT", {"id": name, "sha256": sealed}, 1)
    assert store.current().id == name
    assert store.current().register_id == int(sealed[:8], 16)


def test_a_pointer_that_was_removed_is_told_with_what_it_pointed_to(store):
    store.activate(store.save(Samples(1).calibration()))
    (store.path / "CURRENT").unlink()
    with pytest.raises(NoCurrentCalibration, match=r"CURRENT is gone; cal-000001"):
        store.current()
