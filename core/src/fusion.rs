//! How the matching costs of several views become one.

/// The rule that fuses the costs `c1 <= c2 <= ...` of the views in which a candidate is available.
///
/// Fused costs are exact integers on a common [`scale`](Fusion::scale), so that candidates seen in different numbers of views
/// compare without rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fusion {
    /// The least cost, `c1` (paper, eq. 8): sharp at occlusions, since one view that sees the point is enough.
    Min,
    /// The mean of all costs (paper, eq. 7): quiet, but blurred by the views that do not see the point.
    Mean,
    /// The paper's heuristic rule (eq. 9): the mean of the three least costs, or of the two least if `c3 > 3 c2`. With two
    /// views their mean, with one view its cost.
    Heuristic,
}

impl Fusion {
    /// Every rule.
    pub const ALL: [Fusion; 3] = [Fusion::Min, Fusion::Mean, Fusion::Heuristic];

    /// Its name on command lines and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Fusion::Min => "min",
            Fusion::Mean => "mean",
            Fusion::Heuristic => "heuristic",
        }
    }

    /// The rule the paper uses with this number of views: the minimum for up to two, the heuristic rule for more.
    pub const fn default_for(views: usize) -> Fusion {
        if views <= 2 { Fusion::Min } else { Fusion::Heuristic }
    }

    /// What a cost of one view is multiplied by to be on this rule's scale: 1, 12 or 6.
    pub const fn scale(self) -> u32 {
        match self {
            Fusion::Min => 1,
            Fusion::Mean => 12,
            Fusion::Heuristic => 6,
        }
    }

    /// The fused cost on this rule's [`scale`](Fusion::scale), or `None` if no view is available.
    ///
    /// `costs` holds at most four costs, each at most 21 x 21 x 255, so that no sum leaves 32 bits. Their order does not matter
    /// and is not kept.
    pub fn fuse(self, costs: &mut [u32]) -> Option<u32> {
        sort(costs);
        Some(match (self, &*costs) {
            (_, []) => return None,
            (Fusion::Min, &[c1, ..]) => c1,
            (Fusion::Mean, all) => all.iter().sum::<u32>() * (12 / all.len() as u32),
            (Fusion::Heuristic, &[c1]) => 6 * c1,
            (Fusion::Heuristic, &[c1, c2]) => 3 * (c1 + c2),
            (Fusion::Heuristic, &[c1, c2, c3, ..]) if c3 > 3 * c2 => 3 * (c1 + c2),
            (Fusion::Heuristic, &[c1, c2, c3, ..]) => 2 * (c1 + c2 + c3),
        })
    }
}

/// Sorts by exchange: for four costs, the standard library's sort is large.
fn sort(costs: &mut [u32]) {
    let mut rest = costs;
    while let [first, others @ ..] = rest {
        for other in &mut *others {
            if other < first {
                core::mem::swap(first, other);
            }
        }
        rest = others;
    }
}
