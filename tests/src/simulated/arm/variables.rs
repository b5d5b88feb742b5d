//! The variables of RTDE: names and types, after Universal Robots' guide.

/// The readable variables except the registers, by type.
const OUTPUTS: [(&str, &[&str]); 8] = [
    (
        "DOUBLE",
        &[
            "timestamp",
            "actual_execution_time",
            "speed_scaling",
            "target_speed_fraction",
            "actual_momentum",
            "actual_main_voltage",
            "actual_robot_voltage",
            "actual_robot_current",
            "standard_analog_input0",
            "standard_analog_input1",
            "standard_analog_output0",
            "standard_analog_output1",
            "io_current",
            "tool_analog_input0",
            "tool_analog_input1",
            "tool_output_current",
            "tool_temperature",
            "tcp_force_scalar",
            "payload",
        ],
    ),
    (
        "VECTOR6D",
        &[
            "target_q",
            "target_qd",
            "target_qdd",
            "target_current",
            "target_moment",
            "actual_q",
            "actual_qd",
            "actual_current",
            "actual_current_window",
            "joint_control_output",
            "actual_TCP_pose",
            "actual_TCP_speed",
            "actual_TCP_force",
            "target_TCP_pose",
            "target_TCP_speed",
            "joint_temperatures",
            "actual_joint_voltage",
            "ft_raw_wrench",
            "payload_inertia",
        ],
    ),
    ("VECTOR3D", &["actual_tool_accelerometer", "elbow_position", "elbow_velocity", "payload_cog"]),
    ("VECTOR6INT32", &["joint_mode"]),
    ("INT32", &["robot_mode", "safety_mode", "safety_status", "tool_output_voltage"]),
    (
        "UINT32",
        &[
            "runtime_state",
            "robot_status_bits",
            "safety_status_bits",
            "analog_io_types",
            "tool_mode",
            "tool_analog_input_types",
            "output_bit_registers0_to_31",
            "output_bit_registers32_to_63",
        ],
    ),
    ("UINT64", &["actual_digital_input_bits", "actual_digital_output_bits"]),
    ("UINT8", &["tool_output_mode"]),
];

/// The general-purpose registers, by the prefix of their names.
const REGISTERS: [(&str, &str); 6] = [
    ("output_int_register_", "INT32"),
    ("output_double_register_", "DOUBLE"),
    ("output_bit_register_", "BOOL"),
    ("input_int_register_", "INT32"),
    ("input_double_register_", "DOUBLE"),
    ("input_bit_register_", "BOOL"),
];

/// The type of a readable variable.
pub fn output_type(name: &str) -> Option<&'static str> {
    let plain = OUTPUTS.iter().find(|(_, names)| names.contains(&name)).map(|(kind, _)| *kind);
    plain.or_else(|| register_type(name))
}

/// The type of a writable variable.
pub fn input_type(name: &str) -> Option<&'static str> {
    register_type(name).filter(|_| name.starts_with("input_"))
}

fn register_type(name: &str) -> Option<&'static str> {
    let number = |start: &str| name.strip_prefix(start)?.parse::<u8>().ok();
    REGISTERS.iter().find(|(start, _)| number(start).is_some_and(|number| number < 128)).map(|(_, kind)| *kind)
}

/// The number of bytes that a value of a type takes.
pub fn bytes(kind: &str) -> usize {
    match kind {
        "BOOL" | "UINT8" => 1,
        "INT32" | "UINT32" => 4,
        "DOUBLE" | "UINT64" => 8,
        "VECTOR3D" | "VECTOR6INT32" => 24,
        "VECTOR6D" => 48,
        _ => unreachable!("{kind} is none of the types"),
    }
}
