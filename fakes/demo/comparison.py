"""The paper's methods side by side: what each would have served at the requests of a demo."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fakes.demo.show import ShownRequest
from fakes.studies.paper.baselines import (
    SPECIAL,
    SPECIAL_CAD,
    compare_methods,
    expected_by_method,
)
from fakes.world.world import World
from vgrd.geometry import Array, Pose
from vgrd.model import Observation, Recording
from vgrd.store.sessions import iterate_observations, load_recording

SAME_WRIST_RAD = 0.01  # half a degree; the tilted touches are 15 degrees off and more


def misses_by_method(
    world: World, teaching: Path, requests: Path, served: Sequence[ShownRequest]
) -> Mapping[str, Array]:
    """True misses (n, 3) mm of every method, had the robot gone where that method says.

    Each request is judged by the picture that was recorded for its answer.
    """
    recording = load_recording(teaching)
    methods = compare_methods(recording)
    one_wrist = compare_methods(_constant_wrist(recording))
    observations = [
        observation
        for observation in iterate_observations(requests)
        if observation.tag_b is not None
    ]
    misses: dict[str, list[Array]] = {}
    for request in served:
        observation = _picture_of(request, observations)
        if observation is None:
            continue
        answers = expected_by_method(methods, request.target, observation)
        special = expected_by_method(one_wrist, request.target, observation)
        answers |= {name: special[name] for name in (SPECIAL, SPECIAL_CAD) if name in special}
        for method, flange in answers.items():
            pose = Pose(request.served.rotation, flange)
            miss = world.miss_at(pose, request.target, request.angle_rad)
            misses.setdefault(method, []).append(miss)
    return {method: np.array(values) for method, values in misses.items()}


def _picture_of(request: ShownRequest, observations: Sequence[Observation]) -> Observation | None:
    """The last one recorded until the answer: a picture that shows nothing new is not recorded."""
    answered_s = request.stamp_s + request.latency_s
    return max(
        (observation for observation in observations if observation.stamp_s <= answered_s),
        key=lambda observation: observation.stamp_s,
        default=None,
    )


def _constant_wrist(recording: Recording) -> Recording:
    """The touches that share the first one's orientation: what the special method asks for."""
    first = recording.touches[0].base_from_wrist
    touches = [
        t for t in recording.touches if first.distance(t.base_from_wrist)[1] < SAME_WRIST_RAD
    ]
    return replace(recording, touches=tuple(touches))
