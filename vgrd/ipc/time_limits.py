"""Time limits that several processes rest on; the cell file may set others."""

from typing import Final

DEADLINE_S: Final = 0.25  # a killed, stopped or hanging cell left the registers after 253-255 ms
REQUEST_TIMEOUT_S: Final = 2.0  # for a request without TMO; chosen: an answer takes 0.5 s
