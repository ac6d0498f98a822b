"""Every error the project raises.

::

    VgrdError
      ConfigError            every fault of a file in one message
      InputError             a dataset, a pose list or an argument cannot be used
        CalibrationMismatch  a calibration was made for another cell than the configured one
      DeviceError
        DeviceUnavailable    link down, timeout: retry with back-off
        DeviceRefused        wrong model, licence or version: retry slowly, tell the operator
        BadReading           not a rotation, not finite, clock went back: drop the sample, count it
      ObservationError
        TagNotSeen           the tag is not in the picture
        HoleNotSeen          a hole is not in the picture, hidden, or one of several
        NotSteady            the robot moved during the exposure
        TooOld               the observation is older than allowed
        Contradiction        the picture shows that something moved since the calibration
      CalibrationError
        TooFewObservations   fewer samples than the method needs
        NotObservable        the data leave something undetermined
        DidNotConverge       the iteration found no minimum
      StoreError
        SchemaTooNew         written by a newer version
        Corrupt              the checksum or the structure is wrong
        NoCurrentCalibration nothing has been activated yet
      IpcError               shared memory or a message between processes cannot be used
        RingUnavailable      the ring's file is not there (yet) or is another kind of ring
      ServingError           the registers cannot be served: port taken, address not here
        AlreadyRunning       another daemon uses the runtime folder
      StepFailed             a step of an installation; what ran before runs on
      InternalError          a fault of vgrd itself, as the user is told of it
      ControlError           the daemon refused a command
        DaemonUnreachable    no daemon answers on the control socket
        DaemonSilent         a daemon runs, and does not answer yet: ask again
        StaleVersion         the command was given by what is not so any more: look again

Retrying is decided by type. Messages name what, where and the remedy.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Self, TypeVar

_Kind = TypeVar("_Kind", bound="VgrdError")


class VgrdError(Exception):
    """Root of the tree; `exit_code` is what the command line returns (sysexits.h)."""

    exit_code = 1

    def __reduce__(self) -> tuple[object, ...]:
        """For workers: an error is made anew from its message and facts, whatever its constructor asks for."""
        return _made_again, (type(self), self.args, vars(self))


class ConfigError(VgrdError):
    """A configuration file has faults; `faults` holds them all, one line each."""

    exit_code = os.EX_CONFIG

    def __init__(self, source: str, faults: Sequence[str]) -> None:
        self.source = source
        self.faults = tuple(faults)
        super().__init__("\n".join([f"{source}: {len(self.faults)} fault(s)", *self.faults]))


class InputError(VgrdError):
    """A file or an argument given by the user cannot be used."""

    exit_code = os.EX_DATAERR


class CalibrationMismatch(InputError):
    """A calibration was made for another cell than the one that the cell file describes."""


class DeviceError(VgrdError):
    """A device failed; the object is of no further use."""

    exit_code = os.EX_UNAVAILABLE


class DeviceUnavailable(DeviceError):
    """The link is down or timed out: try again with back-off."""

    exit_code = os.EX_TEMPFAIL


class DeviceRefused(DeviceError):
    """The device is there and says no: wrong model, licence, version, parameter."""

    exit_code = os.EX_UNAVAILABLE


class BadReading(DeviceError):
    """One sample is unusable: drop and count it, keep the device."""


class ObservationError(VgrdError):
    """Nothing usable was observed; shown to the operator, not stored."""


class TagNotSeen(ObservationError):
    """The tag is not in the picture."""


class HoleNotSeen(ObservationError):
    """A hole is not where it should be in the picture, is partly hidden, or is one of several."""


class NotSteady(ObservationError):
    """The robot or the object moved during the exposure."""


class TooOld(ObservationError):
    """The observation is older than allowed."""


class Contradiction(ObservationError):
    """A picture contradicts the calibration beyond chance: something moved. `links` names what, as words.

    size_mm: how far the first of them would have moved.
    """

    def __init__(self, message: str, links: Sequence[str], size_mm: float = 0.0) -> None:
        self.links, self.size_mm = tuple(links), size_mm
        super().__init__(message)


class CalibrationError(VgrdError):
    """The data cannot give what was asked for."""

    exit_code = os.EX_DATAERR

    def with_hints(self, hints: Sequence[str]) -> Self:
        """The same error, its message followed by what may have caused it, a line each."""
        return _made_again(type(self), ("\n".join([str(self), *hints]),), vars(self))


class TooFewObservations(CalibrationError):
    """Fewer samples than the method needs."""


class NotObservable(CalibrationError):
    """The data leave something undetermined; `rank` of `unknowns` columns are determined."""

    def __init__(self, message: str, *, rank: int, unknowns: int) -> None:
        self.rank = rank
        self.unknowns = unknowns
        super().__init__(message)


class DidNotConverge(CalibrationError):
    """The iteration ended without a minimum."""


class StoreError(VgrdError):
    """A stored file cannot be used."""

    exit_code = os.EX_IOERR


class SchemaTooNew(StoreError):
    """Written by a newer version of the program."""


class Corrupt(StoreError):
    """The checksum or the structure of a stored file is wrong."""


class NoCurrentCalibration(StoreError):
    """Nothing has been activated yet."""


class IpcError(VgrdError):
    """Shared memory or a message between processes cannot be used."""

    exit_code = os.EX_SOFTWARE


class RingUnavailable(IpcError):
    """The ring's file is not there (yet) or holds another kind of ring: try again later."""

    exit_code = os.EX_TEMPFAIL


class ServingError(VgrdError):
    """The registers cannot be served at the address that the cell file names."""

    exit_code = os.EX_UNAVAILABLE


class AlreadyRunning(ServingError):
    """Another daemon uses the runtime folder."""


class StepFailed(VgrdError):
    """A step of an installation could not be done; what ran before runs on."""


class InternalError(VgrdError):
    """A fault of vgrd itself: neither the input nor the machine is to blame."""

    exit_code = os.EX_SOFTWARE

    @classmethod
    def of(cls, where: str, fault: BaseException) -> "InternalError":
        """Say in words what went wrong where; the log has the traceback."""
        return cls(
            f"internal error in {where}: {type(fault).__name__}: {fault}; this is a fault of vgrd, "
            "please report it with the daemon's log"
        )


class ControlError(VgrdError):
    """The daemon refused a command; `error` names the error as the daemon saw it, its exit code is ours."""

    def __init__(self, message: str, *, error: str = "ControlError") -> None:
        self.error = error
        self.exit_code = _EXIT_CODES.get(error, type(self).exit_code)
        super().__init__(message)


class DaemonUnreachable(ControlError):
    """No daemon answers on the control socket."""

    exit_code = os.EX_UNAVAILABLE

    def __init__(self, message: str) -> None:
        super().__init__(message, error=type(self).__name__)


class DaemonSilent(ControlError):
    """A daemon runs and does not answer, since it starts or its cell process does: ask again."""

    exit_code = os.EX_TEMPFAIL

    def __init__(self, message: str) -> None:
        super().__init__(message, error=type(self).__name__)


class StaleVersion(ControlError):
    """A command was given by what is not so any more, since somebody else did something: look again."""

    exit_code = os.EX_TEMPFAIL

    def __init__(self, message: str) -> None:
        super().__init__(message, error=type(self).__name__)


def _made_again(kind: type[_Kind], args: tuple[object, ...], facts: Mapping[str, object]) -> _Kind:
    """An error of a kind with these arguments and facts; its constructor is not called."""
    error = kind.__new__(kind, *args)
    vars(error).update(facts)
    return error


def _family(root: type[VgrdError]) -> Iterator[type[VgrdError]]:
    """A class of errors and all that derive from it."""
    yield root
    for kind in root.__subclasses__():
        yield from _family(kind)


def device_error(name: str, message: str) -> DeviceError:
    """An error of a device that another process told by name; DeviceRefused for one that is none."""
    kinds = {kind.__name__: kind for kind in (DeviceUnavailable, DeviceRefused, BadReading)}
    return kinds.get(name, DeviceRefused)(message)


_EXIT_CODES = {kind.__name__: kind.exit_code for kind in _family(VgrdError)}
