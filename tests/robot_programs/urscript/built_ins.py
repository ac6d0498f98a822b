"""URScript's own functions that our programs use: the least and the most arguments.

From the script manuals of PolyScope 5 (modules Interfaces, Internals, Motion, URMath).
"""

from typing import Final

BUILT_INS: Final = {
    "get_actual_tool_flange_pose": (0, 0),
    "get_inverse_kin": (1, 5),
    "get_inverse_kin_has_solution": (1, 5),
    "get_steptime": (0, 0),
    "get_tcp_offset": (0, 0),
    "integer_to_binary_list": (1, 1),
    "modbus_add_rw_signal": (7, 8),
    "modbus_add_signal": (5, 7),
    "modbus_get_error": (1, 2),
    "modbus_get_signal_status": (1, 2),
    "modbus_get_time_since_signal_invalid": (1, 1),
    "modbus_set_output_register": (2, 3),
    "modbus_set_signal_update_frequency": (2, 2),
    "modbus_set_signal_watchdog": (2, 2),
    "movej": (1, 5),
    "movel": (1, 5),
    "norm": (1, 1),
    "popup": (1, 5),
    "pose_inv": (1, 1),
    "pose_trans": (2, 2),
    "sleep": (1, 1),
    "stopl": (1, 2),
    "str_cat": (2, 2),
    "sync": (0, 0),
    "textmsg": (1, 2),
}
