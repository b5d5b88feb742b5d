//! The memory that may be taken.

use std::fs;

/// The most bytes that may be taken: these megabytes, by default what is available. `None` if nothing limits them, or the system
/// does not tell.
pub fn memory_limit(megabytes: Option<u64>) -> Option<u64> {
    megabytes.map(|megabytes| megabytes.saturating_mul(1_000_000)).or_else(available_bytes)
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
        assert!(memory_limit(None).is_some());
        assert_eq!(memory_limit(Some(3)), Some(3_000_000));
    }
}
