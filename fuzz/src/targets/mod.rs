//! The targets: each tries what reads one kind of bytes, or compares one thing with its reference.

mod block_matching;
mod calibrations;
mod camera_frames;
mod confidence;
mod gcode;
mod option_values;
mod packets;
mod pictures;
mod rectification;
mod rigs;
mod robot_arm;
mod semi_global;
mod weights;

/// A target.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The name, which its folder of seeds has too.
    pub name: &'static str,
    /// Tries an input. It panics if the input breaks something, and returns false if the bytes make no input.
    pub run: fn(&[u8]) -> bool,
}

/// Every target, sorted by name.
pub const ALL: [Target; 13] = [
    Target { name: "block_matching", run: block_matching::run },
    Target { name: "calibrations", run: calibrations::run },
    Target { name: "camera_frames", run: camera_frames::run },
    Target { name: "confidence", run: confidence::run },
    Target { name: "gcode", run: gcode::run },
    Target { name: "option_values", run: option_values::run },
    Target { name: "packets", run: packets::run },
    Target { name: "pictures", run: pictures::run },
    Target { name: "rectification", run: rectification::run },
    Target { name: "rigs", run: rigs::run },
    Target { name: "robot_arm", run: robot_arm::run },
    Target { name: "semi_global", run: semi_global::run },
    Target { name: "weights", run: weights::run },
];

impl Target {
    /// The target of this name.
    pub fn named(name: &str) -> Option<Target> {
        ALL.into_iter().find(|target| target.name == name)
    }
}
