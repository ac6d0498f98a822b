"""The paper's methods side by side: what each would have served at the requests of a demo."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fakes.show import Request
from fakes.world import World
from vgrd.calibration.baselines import expected_by_method
from vgrd.geometry import Array, Pose
from vgrd.store.sessions import iterate_observations, load_recording

WITHIN_S = 3.0


def misses_by_method(
    world: World, teaching: Path, requests: Path, served: Sequence[Request]
) -> Mapping[str, Array]:
    """True misses (n, 3) mm of every method, had the robot gone where that method says.

    The observation of a request is the picture recorded nearest in time while the table stood.
    """
    recording = load_recording(teaching)
    observations = [seen for seen in iterate_observations(requests) if seen.tag_b is not None]
    misses: dict[str, list[Array]] = {}
    for request in served:
        observation = min(observations, key=lambda seen: abs(seen.stamp_s - request.stamp_s))
        if abs(observation.stamp_s - request.stamp_s) > WITHIN_S:
            continue
        for method, flange in expected_by_method(recording, request.target, observation).items():
            pose = Pose(request.served.rotation, flange)
            misses.setdefault(method, []).append(
                world.miss_at(pose, request.target, request.angle_rad)
            )
    return {method: np.array(values) for method, values in misses.items()}
