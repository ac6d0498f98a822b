"""Turns documents of older versions into those of this version.

Every document carries its schema. A step takes the JSON of one schema and returns that of the next.
"""

from collections.abc import Callable
from typing import Any

Json = Any

# Since 2: steps of readings, holes, chi2 of a tag; 3: camera's stability; 4: clearances, bare targets, steps as facts;
# 5: how well centre, CAD and tag sizes are known; 6: touches may be given another name.
SESSION_SCHEMA = 6
# Since 2: solution in a table; 3: stability, adopted slips; 4: clearances, bare targets, steps;
# 5: how well centre, CAD and tag sizes are known, and levels of noise.
CALIBRATION_SCHEMA = 5
_ZERO = 0.0


def facts_of(facts: Json) -> Json:
    """CellFacts of schema 1, whose early files lack what holes need."""
    out = _fixed(facts)
    out["object"] = dict(out["object"])
    out["object"].setdefault("hole_sigma_mm", 0.03)  # the default when it was added
    out["object"]["targets"] = {
        name: {"hole_diameter_mm": None, **target}
        for name, target in out["object"]["targets"].items()
    }
    return out


def session_header(schema: int, body: Json) -> Json:
    """Content of session.json."""
    if schema > 4:
        return body
    facts = body["facts"] if schema > 1 else facts_of(body["facts"])
    return {**body, "facts": _facts_up_to_4(facts if schema > 3 else _facts_up_to_3(facts))}


def _fixed(facts: Json) -> Json:
    """CellFacts up to schema 2: a camera was taken to stand still while it was taught."""
    return {"camera_stability": "fixed", **facts}


def _facts_up_to_3(facts: Json) -> Json:
    """CellFacts that tell neither the steps of the robot's poses nor clearances of targets."""
    targets = {name: _target(target) for name, target in facts["object"]["targets"].items()}
    steps = {"robot_step_mm": _ZERO, "robot_step_rad": _ZERO}
    return {**steps, **_fixed(facts), "object": {**facts["object"], "targets": targets}}


def _facts_up_to_4(facts: Json) -> Json:
    """CellFacts when the centre was taken to be known to 0.02 mm, targets and tag sizes exactly."""
    exact = {"tag_a_sigma_mm": _ZERO, "tag_b_sigma_mm": _ZERO}
    known = {"center_sigma_mm": 0.02, "cad_sigma_mm": _ZERO}  # as they were written in the program
    return {**exact, **facts, "object": {**known, **facts["object"]}}


def _target(body: Json) -> Json:
    return {"clearance_mm": None, **body}


def observation(body: Json) -> Json:
    """An observation of any schema: early ones do not tell since when the arm stood.

    Early tags do not tell how well the picture fits.
    """
    with_tags = _tagged(body)
    return {"rest_since_s": None, **with_tags} if isinstance(with_tags, dict) else with_tags


def sample(body: Json) -> Json:
    """An observation or a touch of any schema."""
    if isinstance(body, dict) and "target" in body:
        return _changed(body, "observation", observation)
    return observation(body)


def reading(body: Json) -> Json:
    """A reading of the robot: early ones do not tell the steps of the interface."""
    return {"step_mm": _ZERO, "step_rad": _ZERO, **body} if isinstance(body, dict) else body


def _tagged(body: Json) -> Json:
    return _changed(_changed(body, "tag_a", _tag), "tag_b", _tag)


def _tag(body: Json) -> Json:
    return {"chi2": 1.0, **body}


def _changed(body: Json, key: str, change: Callable[[Json], Json]) -> Json:
    """The body with one of its tables changed; what is no such table is left to the decoder."""
    if not isinstance(body, dict) or not isinstance(body.get(key), dict):
        return body
    return {**body, key: change(body[key])}


def calibration(schema: int, body: Json) -> Json:
    """Content of a calibration's file: the solution of schema 1 lay open in it."""
    if schema > 4:
        return body
    if schema > 3:
        facts = _facts_up_to_4(body["facts"])
        return _changed({**body, "facts": facts}, "solution", _exact)
    opened = body if schema > 1 else _opened(body)
    taught = {name: _changed(point, "target", _target) for name, point in opened["taught"].items()}
    facts = _facts_up_to_4(_facts_up_to_3(opened["facts"]))
    moved = {"adopted": [], **opened, "facts": facts, "taught": taught}
    return _changed(_changed(moved, "solution", _solution), "solution", _in_cad_exactly)


def _solution(body: Json) -> Json:
    """Early ones of the special plan do not tell where tag A was in the reference picture."""
    return {"reference_tag_a": None, **body} if body.get("method") == "special" else body


def _in_cad_exactly(body: Json) -> Json:
    """A joint solution up to schema 3: every target was in CAD."""
    bare: Json = {"bare": [], "bare_in_base": []} if body.get("method") == "joint" else {}
    return _exact({**bare, **body})


def _exact(body: Json) -> Json:
    """A joint solution up to schema 4: nothing of the cell file was an unknown, no level was found."""
    held: Json = {"inexact": [], "offsets_in_object": [], "refined": {}, "levels": []}
    return {**held, **body} if body.get("method") == "joint" else body


def _opened(body: Json) -> Json:
    """Content of schema 1 as that of schema 2."""
    shared = {
        key: body[key] for key in ("id", "session", "created_unix_s", "residuals", "verdict")
    }
    taught = {
        name: {key: value for key, value in point.items() if key != "joint_covariance"}
        for name, point in body["taught"].items()
    }
    for point in taught.values():
        point["target"] = {"hole_diameter_mm": None, **point["target"]}
    joint = body.get("joint")
    solution = _stepwise(body) if joint is None else _joint(joint)
    return {**shared, "facts": facts_of(body["facts"]), "taught": taught, "solution": solution}


def _joint(joint: Json) -> Json:
    names = {"tcp_in_wrist": "tip_in_wrist", "moves": "object_motions"}
    arm = {"by_unknowns": "J_unknowns"}
    out = {names.get(key, key): value for key, value in joint.items()}
    out["arm"] = {arm.get(key, key): value for key, value in joint["arm"].items()}
    return {"method": "joint", "has_point": False, **out}


def _stepwise(body: Json) -> Json:
    none = [[_ZERO] * 6 for _ in range(6)]
    pivot = None
    if body["pivot_in_tag_b"] is not None and body["pivot_in_base"] is not None:
        pivot = {
            "in_tag_b": body["pivot_in_tag_b"],
            "in_base": body["pivot_in_base"],
            "covariance": body.get("pivot_covariance") or [[_ZERO] * 3 for _ in range(3)],
        }
    solution = {
        "method": body["method"],
        "chain": {
            "base_from_camera": body["base_from_camera"],
            "hand_eye_covariance": body["hand_eye_covariance"],
            "camera_from_tag_b": body["camera_from_tag_b_ref"],
            "reference_covariance": body.get("reference_covariance") or none,
        },
        "wrist_from_tag_a": body["wrist_from_tag_a"],
        "pivot": pivot,
        "touch_covariances": {
            name: point["joint_covariance"]
            for name, point in body["taught"].items()
            if point["joint_covariance"] is not None
        },
    }
    if body["method"] == "universal":
        solution["tcp"] = {"in_wrist": body["tcp_in_wrist"], "covariance": body["tcp_covariance"]}
    return solution
