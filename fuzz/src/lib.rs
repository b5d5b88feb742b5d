//! Fuzz targets: what reads outside bytes, and what must equal its reference.
//!
//! libFuzzer runs them guided by coverage (the program `guided`), and the program `blind` on random changes of seeds: many by
//! `cargo xtask fuzz --blind`, a few in the tests.
//!
//! | module | what it is |
//! | --- | --- |
//! | `comparisons` | targets that compare a computation with its reference, bit for bit |
//! | `readers` | targets that read bytes from outside |

mod comparisons;
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
pub const TARGETS: [Target; 14] = [
    Target { name: "block_matching", run: comparisons::block_matching },
    Target { name: "calibrations", run: readers::calibrations },
    Target { name: "camera_frames", run: readers::camera_frames },
    Target { name: "commands", run: readers::commands },
    Target { name: "confidence", run: comparisons::confidence },
    Target { name: "gcode", run: readers::gcode },
    Target { name: "option_values", run: readers::option_values },
    Target { name: "packets", run: readers::packets },
    Target { name: "pictures", run: readers::pictures },
    Target { name: "rectification", run: comparisons::rectification },
    Target { name: "rigs", run: readers::rigs },
    Target { name: "robot_arm", run: readers::robot_arm },
    Target { name: "semi_global", run: comparisons::semi_global },
    Target { name: "weights", run: readers::weights },
];

impl Target {
    /// The target of this name.
    pub fn named(name: &str) -> Option<Target> {
        TARGETS.into_iter().find(|target| target.name == name)
    }
}
