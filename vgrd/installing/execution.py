"""Carries out a plan, step by step; one that fails is told, and leaves what ran before running."""

import fcntl
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from vgrd.errors import InputError, StepFailed, VgrdError
from vgrd.installing.plans import Plan
from vgrd.installing.steps import Command, Step

Tell = Callable[[str], None]


def show(plan: Plan, tell: Tell) -> None:
    """Tell every step; nothing is done."""
    for step in (*plan.prepare, *plan.switch, *plan.tidy):
        tell(f"would {step}")


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Only one installation at a time works in `folder`. Raises InputError where another one does."""
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise InputError(
            f"{folder}: {error.strerror}; name a folder of yours: --root DIR"
        ) from error
    try:
        _lock(descriptor, folder)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, folder: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"{folder}: another installation is at work; wait for its end") from None


def carry_out(plan: Plan, tell: Tell) -> None:
    """Do it all. Raises StepFailed naming the step, when all is as it was before."""
    try:
        _perform(plan.prepare, tell)
    except StepFailed as error:
        _undo(plan.discard, tell)
        raise StepFailed(f"{error}\nNothing was changed that runs") from error
    try:
        _perform(plan.switch, tell)
    except StepFailed as error:
        _undo(plan.back, tell)
        outcome = "The version before is in use again" if plan.back else "Mend that and repeat"
        raise StepFailed(f"{error}\n{outcome}") from error
    _perform(plan.tidy, tell)


def _perform(steps: Sequence[Step], tell: Tell) -> None:
    for step in steps:
        tell(str(step))
        try:
            step.perform()
        except KeyboardInterrupt as stop:
            raise StepFailed(f"stopped by you, at: {step}") from stop
        except (OSError, VgrdError) as error:
            remedy = step.remedy if isinstance(step, Command) else ""
            raise StepFailed(
                f"could not {step}: {error}" + (f"\n{remedy}" if remedy else "")
            ) from error


def _undo(steps: Sequence[Step], tell: Tell) -> None:
    """Go on whatever fails: the later steps help without it."""
    for step in steps:
        try:
            _perform([step], tell)
        except StepFailed as error:
            tell(str(error))
