"""From a device's clock to the cell clock."""

from collections import deque

WINDOW_S = 10.0  # clocks of 50 ppm drift by 0.5 ms in this time


class ClockMapping:
    """Minimum-delay mapping: the shortest (receive - device) time of the last `window_s` seconds.

    Queueing and scheduling only ever add delay. So the minimum is the transport time plus the
    offset of the clocks. The window lets it follow their drift (50 ppm of 10 s is 0.5 ms).
    """

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        self._candidates: deque[tuple[float, float]] = deque()

    def add(self, device_s: float, received_s: float) -> None:
        """Take one sample: stamped `device_s` by the device, received at `received_s`."""
        offset_s = received_s - device_s
        while self._candidates and self._candidates[-1][1] >= offset_s:
            self._candidates.pop()
        self._candidates.append((received_s, offset_s))
        while self._candidates[0][0] < received_s - self._window_s:
            self._candidates.popleft()

    def cell_s(self, device_s: float) -> float:
        """Cell clock at the device's time `device_s`; needs one sample before."""
        return device_s + self._candidates[0][1]

    def reset(self) -> None:
        """Forget everything: the device's clock has jumped."""
        self._candidates.clear()
