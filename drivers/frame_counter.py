"""Frame numbers that must advance."""

from vgrd.errors import BadReading


class FrameCounter:
    """Counts on over the wrap of a camera's frame number: after `wrap_at` comes 1 (or 0)."""

    def __init__(self, wrap_at: int) -> None:
        self._wrap_at = wrap_at
        self._last: int | None = None
        self._number = 0

    def advance(self, frame: int) -> int:
        """Return the running number of the camera's `frame`; BadReading when it did not advance.

        A step of more than half the range backwards is a wrap, a smaller one a fault.
        """
        last, self._last = self._last, frame
        if last is None:
            self._number += 1
            return self._number
        step = frame - last
        if step < -self._wrap_at // 2:
            step += self._wrap_at
        if step <= 0:
            raise BadReading(f"the camera's frame number went from {last} to {frame}")
        self._number += step
        return self._number

    def restart(self) -> None:
        """Take any next number: many cameras count from 1 again when they start anew."""
        self._last = None
