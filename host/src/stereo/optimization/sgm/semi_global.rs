//! What semi-global matching charges, and along which paths.

use multiscopic_core::Fusion;

use crate::{
    error::{Error, Result},
    stereo::cost::Census,
};

/// Where paths come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paths {
    /// Left, right, top and bottom, in two passes.
    Four,
    /// Left, right, and from the top straight and along both diagonals, in one pass.
    #[default]
    Five,
    /// All eight sides, in two passes.
    Eight,
}

impl Paths {
    /// The number of paths.
    pub const fn count(self) -> usize {
        match self {
            Paths::Four => 4,
            Paths::Five => 5,
            Paths::Eight => 8,
        }
    }
}

/// The parameters of semi-global matching. Every value of this type is valid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SemiGlobal {
    paths: Paths,
    p1: u16,
    p2: u16,
    p2_edge: Option<u8>,
}

// On the scale of any fusion, the sums of eight paths through census costs fit 16 bits. A path costs at most
// a cost and P2.
const _: () = assert!(8 * 12 * (SemiGlobal::MAX_PENALTY as u32 + Census::MAX_COST as u32) < u16::MAX as u32);

impl Default for SemiGlobal {
    /// Five paths, and the penalties for the default census.
    fn default() -> SemiGlobal {
        let [p1, p2] = Census::default().default_penalties();
        SemiGlobal { paths: Paths::default(), p1, p2, p2_edge: Some(SemiGlobal::DEFAULT_P2_EDGE) }
    }
}

impl SemiGlobal {
    /// The greatest penalty.
    pub const MAX_PENALTY: u16 = 650;

    /// The default change of brightness above which P2 is lowered.
    pub const DEFAULT_P2_EDGE: u8 = 10;

    /// Semi-global matching with the penalties `p1` for a change by one disparity from a pixel to the next on
    /// a path, and `p2` for any larger change. They are in units of the cost of one view (bits of the
    /// census), whatever the fusion.
    ///
    /// Where the brightness changes by more than `p2_edge` from a pixel to the next, `p2` is lowered to `p2 *
    /// p2_edge / change`, rounded down, but not below `p1`.
    ///
    /// # Errors
    /// If `p2` is below `p1` or above [`MAX_PENALTY`](SemiGlobal::MAX_PENALTY).
    pub fn new(paths: Paths, [p1, p2]: [u16; 2], p2_edge: Option<u8>) -> Result<SemiGlobal> {
        if p1 > p2 || p2 > SemiGlobal::MAX_PENALTY {
            let most = SemiGlobal::MAX_PENALTY;
            return Err(Error::Usage(format!("P1 is {p1} and P2 is {p2}, it must be P1 <= P2 <= {most}")));
        }
        Ok(SemiGlobal { paths, p1, p2, p2_edge })
    }

    /// The paths.
    pub fn paths(&self) -> Paths {
        self.paths
    }

    /// The penalty P1.
    pub fn p1(&self) -> u16 {
        self.p1
    }

    /// The penalty P2 for a change of brightness.
    pub fn p2(&self, change: u8) -> u16 {
        match self.p2_edge {
            Some(edge) if change > edge => (u32::from(self.p2) * u32::from(edge) / u32::from(change)).max(self.p1.into()) as u16,
            _ => self.p2,
        }
    }

    /// Checks that the sums of all paths stay below `u16::MAX`, if fused costs are at most `max_cost`. Census
    /// costs always pass.
    ///
    /// # Errors
    /// [`Error::Usage`] with the greatest sum.
    pub fn check_sums(&self, max_cost: u16, fusion: Fusion) -> Result<()> {
        let path = u32::from(max_cost) + fusion.scale() * u32::from(self.p2);
        let sum = self.paths.count() as u32 * path;
        if sum < u32::from(u16::MAX) {
            return Ok(());
        }
        let (paths, fusion) = (self.paths.count(), fusion.name());
        Err(Error::Usage(format!(
            "the costs of {paths} paths, fused by {fusion}, may sum to {sum}, which must stay below {}: use fewer paths, a smaller P2 or min",
            u16::MAX
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn census_costs_always_fit_and_large_costs_are_refused() {
        let largest = SemiGlobal::new(Paths::Eight, [0, SemiGlobal::MAX_PENALTY], None).unwrap();
        for fusion in Fusion::ALL {
            assert!(largest.check_sums(Census::MAX_COST * fusion.scale() as u16, fusion).is_ok());
        }
        let message = largest.check_sums(10_000, Fusion::Min).unwrap_err().to_string();
        assert!(message.contains("8 paths") && message.contains("85200"), "{message}");
    }
}
