"""Files of earlier versions still load; `schema_1` holds what one of them wrote, and what it answered."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fakes.world.samples import Samples
from vgrd.calibration.calibration import expected_coordinate
from vgrd.errors import Corrupt
from vgrd.geometry import Pose
from vgrd.model import CellFacts, Observation, Policy, Stability, TagObservation, Touch
from vgrd.store import migrations
from vgrd.store.calibrations import CalibrationStore
from vgrd.store.encoding import decode, encode
from vgrd.store.files import read_sealed, write_document

OLD = Path(__file__).with_name("schema_1")
METHODS = ("joint", "universal", "special")


def loaded(method, tmp_path):
    (tmp_path / "calibrations").mkdir(exist_ok=True)
    name = json.loads((OLD / f"{method}.json").read_text())["body"]["id"]
    shutil.copy(OLD / f"{method}.json", tmp_path / "calibrations" / f"{name}.json")
    return CalibrationStore(tmp_path), name


@pytest.mark.parametrize("method", METHODS)
def test_a_calibration_of_schema_1_answers_as_the_version_did_that_wrote_it(method, tmp_path):
    store, name = loaded(method, tmp_path)
    calibration = store.load(name)
    assert calibration.method == method
    told = json.loads((OLD / "answers.json").read_text())[method]
    tag_b = decode(TagObservation, told["tag_b"], "answers.json")
    for policy, key in ((Policy.FIXED, ""), (Policy.FOLLOW, "follow_")):
        expected = expected_coordinate(calibration, told["target"], tag_b, policy)
        then = decode(Pose, told[key.rstrip("_") or "fixed"], "answers.json")
        np.testing.assert_allclose(expected.base_from_wrist.matrix(), then.matrix(), atol=1e-9)
        assert expected.u95_mm == pytest.approx(told[f"{key}u95_mm"], rel=1e-9)
    assert expected.u95_rad == pytest.approx(told["follow_u95_rad"], rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_what_is_loaded_is_saved_in_the_schema_of_today(method, tmp_path):
    store, name = loaded(method, tmp_path)
    again = store.save(store.load(name))
    sealed = read_sealed(
        tmp_path / "calibrations" / f"{again}.json", migrations.CALIBRATION_SCHEMA
    )
    assert sealed.schema == migrations.CALIBRATION_SCHEMA
    assert sealed.body == encode(store.load(again))


def test_a_body_of_schema_1_that_lacks_a_table_is_corrupt_by_name(tmp_path):

    body = json.loads((OLD / "joint.json").read_text())["body"]
    del body["taught"]
    path = tmp_path / "calibrations" / "cal-000001.json"
    path.parent.mkdir()
    write_document(path, body, 1)
    with pytest.raises(Corrupt, match=r"cal-000001\.json: is not what schema 1 holds.*taught"):
        CalibrationStore(tmp_path).load("cal-000001")


def test_early_samples_lack_what_was_added_later():
    samples = Samples(3)
    touch = encode(samples.touch())
    for tag in ("tag_a", "tag_b"):
        if touch["observation"][tag] is not None:
            del touch["observation"][tag]["chi2"]
    old = decode(Touch, migrations.sample(touch), "samples")
    assert all(t.chi2 == 1.0 for t in (old.observation.tag_a, old.observation.tag_b) if t)
    look = encode(old.observation)
    assert decode(Observation, migrations.sample(look), "samples").stamp_s == look["stamp_s"]


def test_early_cell_facts_lack_what_holes_need():
    facts = encode(Samples(3).facts())
    del facts["object"]["hole_sigma_mm"]
    for target in facts["object"]["targets"].values():
        del target["hole_diameter_mm"]
    del facts["camera_stability"]
    moved = migrations.session_header(1, {"facts": facts})["facts"]
    assert moved["camera_stability"] == "fixed"
    assert moved["object"]["hole_sigma_mm"] == 0.03
    assert all(t["hole_diameter_mm"] is None for t in moved["object"]["targets"].values())


def test_the_camera_of_schema_2_stood_still_while_it_was_taught():
    facts = encode(Samples(3).facts())
    del facts["camera_stability"]
    for migrate in (migrations.session_header, migrations.calibration):
        moved = migrate(2, {"facts": facts, "taught": {}})["facts"]
        assert decode(CellFacts, moved, "facts").camera_stability is Stability.FIXED
    kept = encode(replace(Samples(3).facts(), camera_stability=Stability.MOVABLE))
    assert migrations.session_header(3, {"facts": kept})["facts"] == kept


def test_targets_of_schema_3_tell_no_clearance(tmp_path):
    store, name = loaded("joint", tmp_path)
    body = encode(store.load(name))
    for target in body["facts"]["object"]["targets"].values():
        del target["clearance_mm"]
    for point in body["taught"].values():
        del point["target"]["clearance_mm"]
    path = tmp_path / "calibrations" / "cal-000777.json"
    write_document(path, {**body, "id": "cal-000777"}, 3)
    read = store.load("cal-000777")
    assert all(point.target.clearance_mm is None for point in read.taught.values())
    header = migrations.session_header(3, {"facts": body["facts"]})["facts"]
    assert decode(CellFacts, header, "facts").object.targets.keys() == read.taught.keys()


def test_the_robot_of_schema_3_told_no_steps():
    facts = encode(Samples(3).facts())
    del facts["robot_step_mm"], facts["robot_step_rad"]
    for migrate in (migrations.session_header, migrations.calibration):
        moved = decode(CellFacts, migrate(3, {"facts": facts, "taught": {}})["facts"], "facts")
        assert (moved.robot_step_mm, moved.robot_step_rad) == (0.0, 0.0)
    kept = encode(replace(Samples(3).facts(), robot_step_mm=0.1))
    assert migrations.session_header(4, {"facts": kept})["facts"] == kept


def test_early_special_calibrations_do_not_tell_where_tag_a_was(tmp_path):
    store, name = loaded("special", tmp_path)
    body = encode(store.load(name))
    assert body["solution"].pop("reference_tag_a") is None
    path = tmp_path / "calibrations" / "cal-000777.json"
    write_document(path, {**body, "id": "cal-000777"}, 2)
    assert store.load("cal-000777").solution.reference_tag_a is None


def test_all_targets_of_a_joint_calibration_of_schema_3_were_in_cad(tmp_path):
    store, name = loaded("joint", tmp_path)
    calibration = store.load(name)
    body = encode(calibration)
    assert body["solution"].pop("bare") == []
    assert body["solution"].pop("bare_in_base") == []
    path = tmp_path / "calibrations" / "cal-000777.json"
    write_document(path, {**body, "id": "cal-000777"}, 3)
    solution = store.load("cal-000777").solution
    assert solution.bare == ()
    assert solution.layout.size == calibration.solution.layout.size
