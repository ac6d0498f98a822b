"""Time limits that several processes rest on; the cell file may set others."""

from typing import Final

# Of silence of the cell: a killed, stopped or hanging one left the registers after 253-255 ms.
DEADLINE_S: Final = 0.25
REQUEST_TIMEOUT_S: Final = 2.0  # for a request without TMO; chosen: an answer takes 0.5 s
