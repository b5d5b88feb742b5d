//! The targets: each tries what reads one kind of bytes, or compares one thing with its reference.

mod comparisons;
mod devices;
mod readers;

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
    Target { name: "block_matching", run: comparisons::block_matching },
    Target { name: "calibrations", run: readers::calibrations },
    Target { name: "camera_frames", run: devices::camera_frames },
    Target { name: "confidence", run: comparisons::confidence },
    Target { name: "gcode", run: devices::gcode },
    Target { name: "option_values", run: readers::option_values },
    Target { name: "packets", run: devices::packets },
    Target { name: "pictures", run: readers::pictures },
    Target { name: "rectification", run: comparisons::rectification },
    Target { name: "rigs", run: readers::rigs },
    Target { name: "robot_arm", run: devices::robot_arm },
    Target { name: "semi_global", run: comparisons::semi_global },
    Target { name: "weights", run: readers::weights },
];

impl Target {
    /// The target of this name.
    pub fn named(name: &str) -> Option<Target> {
        ALL.into_iter().find(|target| target.name == name)
    }
}
