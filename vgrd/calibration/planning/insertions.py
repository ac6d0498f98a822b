"""How often things will go into their holes, and how many touches more make it often enough."""

from bisect import bisect_left
from itertools import accumulate, cycle, islice

from vgrd.calibration.insertion import Insertion, insertion_odds, mean_insertion
from vgrd.calibration.joint import JointFit
from vgrd.calibration.planning.predicted_error import PredictedError
from vgrd.calibration.planning.reach import Touching, known_targets, usual_wrist
from vgrd.geometry import Array

CLEAN_WANTED = 0.95  # without contact: one bottle in twenty may touch its rim
_MOST_TOUCHES = 200  # nobody touches more often


def predicted_insertions(
    result: JointFit, foresight: PredictedError, covariance: Array
) -> dict[str, Insertion]:
    """By target with a clearance: the mean over all that the job asks of it."""
    facts = result.recording.facts
    odds: dict[str, list[Insertion]] = {}
    for asked, miss in zip(foresight.asked, foresight.miss_covariances(covariance), strict=True):
        clearance_mm = facts.object.targets[asked.target].clearance_mm
        if clearance_mm is not None:
            axis = asked.base_from_wrist @ facts.tool.axis_in_wrist
            odds.setdefault(asked.target, []).append(insertion_odds(miss, axis, clearance_mm))
    return {name: mean_insertion(each) for name, each in odds.items()}


def further_touches(
    result: JointFit, foresight: PredictedError, share: float = CLEAN_WANTED
) -> int | None:
    """How many touches more, of each target in turn as it is touched now, until so many go in clean.

    Every target with a clearance must reach the share. None: more than anybody would touch.
    """
    targets = known_targets(result)
    touches = [Touching(name, usual_wrist(result.recording, name)) for name in targets]
    rows = islice(cycle(foresight.rows(touches)), _MOST_TOUCHES)
    covariances = list(accumulate(rows, foresight.with_rows, initial=foresight.covariance))

    def least_clean(covariance: Array) -> float:
        odds = predicted_insertions(result, foresight, covariance).values()
        return min((each.clean for each in odds), default=1.0)

    count = bisect_left(covariances, share, key=least_clean)  # no touch makes it worse
    return None if count > _MOST_TOUCHES else count
