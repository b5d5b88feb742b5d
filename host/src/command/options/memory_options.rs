//! How much memory the program may take, and what is told of it.

use std::fs;

use clap::{Args, value_parser};
use multiscopic::{Alignment, Frames, Result};

use crate::command::terminal;

/// From how many megabytes on the user is told.
const MUCH: u64 = 1000;

/// The memory that the program may take.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct MemoryOptions {
    /// Refuse what takes more memory, in megabytes [default: what is available]
    #[arg(long, value_name = "MB", value_parser = value_parser!(u64).range(1..))]
    max_memory: Option<u64>,
}

impl MemoryOptions {
    /// The most bytes that may be taken. `None` if nothing limits them.
    pub fn most_bytes(&self) -> Option<u64> {
        self.max_memory.map(|megabytes| megabytes.saturating_mul(1_000_000)).or_else(available_bytes)
    }

    /// Checks that the alignment of `frames` may take what it takes.
    ///
    /// # Errors
    /// Those of [`Alignment::check_memory`].
    pub fn check_alignment(&self, frames: &Frames) -> Result<()> {
        say_if_much("aligning", Alignment::bytes(frames));
        Alignment::check_memory(frames, self.most_bytes())
    }
}

/// Tells how much memory is taken, if it is much.
pub fn say_if_much(what: &str, bytes: u64) {
    let megabytes = bytes.div_ceil(1_000_000);
    if megabytes >= MUCH {
        terminal::say(&format!("{what} takes about {megabytes} MB of memory"));
    }
}

/// The bytes that are available: of the machine, of the group of processes that this one is in, and of its address space. `None`
/// where the system does not tell.
fn available_bytes() -> Option<u64> {
    let text = |path: &str| fs::read_to_string(path).ok();
    let machine = text("/proc/meminfo").and_then(|text| kibibytes(&text, "MemAvailable:"));
    let group = |name: &str| text(&format!("/sys/fs/cgroup/{name}"))?.trim().parse::<u64>().ok();
    let group = group("memory.max").zip(group("memory.current")).map(|(most, taken)| most.saturating_sub(taken));
    let limit = text("/proc/self/limits").and_then(|text| address_space(&text));
    let taken = text("/proc/self/status").and_then(|text| kibibytes(&text, "VmSize:"));
    // Threads reserve addresses that they never use.
    let addresses = limit.zip(taken).map(|(most, taken)| most.saturating_sub(taken) / 2);
    [machine, group, addresses].into_iter().flatten().min()
}

/// The value of a line such as `VmSize:  123 kB`, in bytes.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let value = text.lines().find_map(|line| line.strip_prefix(name))?;
    value.trim().strip_suffix(" kB")?.parse::<u64>().ok()?.checked_mul(1024)
}

/// The soft limit of the address space. `None` if there is none.
fn address_space(limits: &str) -> Option<u64> {
    limits.lines().find_map(|line| line.strip_prefix("Max address space"))?.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_linux_tells_is_understood() {
        assert_eq!(kibibytes("MemTotal:  9 kB\nMemAvailable:   7654 kB\n", "MemAvailable:"), Some(7654 * 1024));
        assert_eq!(kibibytes("MemTotal:  9 kB\n", "MemAvailable:"), None);
        let limits = "Limit                     Soft Limit           Hard Limit           Units     \n\
                      Max address space         400000000            unlimited            bytes     \n";
        assert_eq!(address_space(limits), Some(400_000_000));
        assert_eq!(address_space(&limits.replace("400000000", "unlimited")), None);
        #[cfg(target_os = "linux")]
        assert!(available_bytes().is_some());
    }
}
