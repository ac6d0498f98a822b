"""Names and wire types of what a UR controller can stream over RTDE."""

FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
_NAMES_BY_TYPE = {
    "VECTOR6D": (
        "target_q target_qd target_qdd target_current target_moment actual_q actual_qd "
        "actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force "
        "target_TCP_pose target_TCP_speed joint_temperatures actual_joint_voltage ft_raw_wrench "
        "payload_inertia tcp_offset actual_current_as_torque"
    ),
    "DOUBLE": (
        "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum "
        "actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 "
        "standard_analog_input1 standard_analog_output0 standard_analog_output1 payload "
        + " ".join(f"output_double_register_{n}" for n in range(48))
    ),
    "VECTOR3D": "actual_tool_accelerometer payload_cog",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
    "INT32": "robot_mode safety_mode safety_status "
    + " ".join(f"output_int_register_{n}" for n in range(48)),
    "VECTOR6INT32": "joint_mode",
    "UINT32": (
        "runtime_state robot_status_bits safety_status_bits output_bit_registers0_to_31 "
        "output_bit_registers32_to_63"
    ),
}
OUTPUT_TYPES = {name: kind for kind, names in _NAMES_BY_TYPE.items() for name in names.split()}
