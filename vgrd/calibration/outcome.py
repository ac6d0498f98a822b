"""What a plan hands on: a solution, the targets as taught, and what speaks against it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from vgrd.model import Finding, Recording, TaughtPoint

SolutionT = TypeVar("SolutionT", covariant=True)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[SolutionT]):
    """Outcome of one plan; taught: by name of the target, residuals: by name with their unit.

    recording: as it would be had the camera stood all the time where it does in the end; None: it did.
    """

    solution: SolutionT
    taught: Mapping[str, TaughtPoint]
    residuals: Mapping[str, float]
    findings: Sequence[Finding]
    recording: Recording | None = None
