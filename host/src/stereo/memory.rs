//! The memory that a match takes, and the memory that may be taken.

use std::fs;

use multiscopic_core::{Frame, SearchSpace};

use super::{
    Engine, Paths,
    baselines::{self, BaselineRefinement},
    cost::{CensusPairRows, mccnn::Architecture},
    method::{Method, Pipeline},
    network::Bands,
};
use crate::images::Frames;

impl Method {
    /// Estimates the bytes that it takes to match these frames and to compute confidences, the frames included.
    ///
    /// Of graph cuts it is counted. Of others it is a line through what the program took at up to eight views and 64
    /// disparities, rounded up: up to twice as much, or a little more if no image has colors.
    pub fn bytes(&self, search: &SearchSpace, frames: &Frames) -> u64 {
        let bytes = |search: &SearchSpace| self.bytes_of_all(&self.refinement.margin.widened(search), frames);
        self.searches(search).iter().map(bytes).max().unwrap_or_default()
    }

    /// The searches of a match, one after the other: with the network, each of several baselines has its own.
    fn searches(&self, search: &SearchSpace) -> Vec<SearchSpace> {
        let sets = BaselineRefinement::sets(search.views());
        let longer = match (&self.pipeline, self.long_baselines, &sets[..]) {
            (Pipeline::Network(_), Some(_), [_, longer @ ..]) => longer,
            _ => &[],
        };
        [*search].into_iter().chain(longer.iter().filter_map(|&views| baselines::at_own_baseline(search, views))).collect()
    }

    /// [`bytes`](Method::bytes) of a search that has its margin.
    fn bytes_of_all(&self, search: &SearchSpace, frames: &Frames) -> u64 {
        let (pixels, views, disparities) = (search.width() * search.height(), search.views().len(), search.num_disparities());
        // Costs are kept in whole vectors.
        let lanes = disparities.next_multiple_of(32) as f64;
        let network = 80.0 + 2.0 * lanes + CensusPairRows::bytes_of_pixel(search.views()) as f64;
        let matching = match &self.pipeline {
            Pipeline::GraphCuts { cost, cuts } => {
                let colored = frames.color(Frame::Center).is_some();
                // Bands and their margins come on top.
                1.5 * cuts.bytes(*cost, search, colored) as f64 / pixels as f64
            }
            Pipeline::Network(_) => network,
            Pipeline::McCnn { network, .. } => {
                let features = match network.architecture() {
                    Architecture::Fast => 30.0 + 65.0 * views as f64,
                    Architecture::Accurate => 1000.0 + 100.0 * views as f64,
                };
                features + (7.0 + 0.5 * views as f64) * disparities as f64
            }
            Pipeline::SemiGlobal { paths, .. } => match paths.paths {
                Paths::Five if self.refinement.left_right.is_none() => 5.0 * views as f64,
                _ => 14.0 + 2.0 * lanes + 8.0 * views as f64,
            },
            Pipeline::BlockMatching { .. } if self.refinement.left_right.is_none() => 0.0,
            Pipeline::BlockMatching { .. } => 30.0 + 8.0 * lanes,
        };
        let opinion = if self.is_judged_by_network() { network } else { 0.0 };
        image_bytes(search) + (pixels as f64 * (matching + opinion)) as u64
    }

    /// The bands that the network is computed in: none if it fits at once into the memory that the engine may take. The search
    /// has its margin.
    pub(super) fn bands(&self, search: &SearchSpace, frames: &Frames, engine: &Engine) -> Option<Bands> {
        let most = engine.most_bytes().filter(|&most| self.bytes_of_all(search, frames) > most)?;
        let is_network = matches!(self.pipeline, Pipeline::Network(_)) && search.check_views().is_ok();
        Bands::within(most.saturating_sub(image_bytes(search)), search).filter(|_| is_network)
    }

    /// Estimates [`bytes`](Method::bytes), in bands if the network does not fit at once.
    pub(super) fn least_bytes(&self, search: &SearchSpace, frames: &Frames, engine: &Engine) -> u64 {
        let bytes = |search: &SearchSpace| {
            let search = &self.refinement.margin.widened(search);
            match self.bands(search, frames, engine) {
                Some(bands) => image_bytes(search) + bands.bytes(search),
                None => self.bytes_of_all(search, frames),
            }
        };
        self.searches(search).iter().map(bytes).max().unwrap_or_default()
    }
}

/// The bytes of the images and of the result.
fn image_bytes(search: &SearchSpace) -> u64 {
    (search.width() * search.height() * (14 + 4 * (search.views().len() + 1))) as u64
}

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
