//! The parameters of graph cuts, and the pixels and labels that they work on.

/// The rule for pixels without a match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Matches are unique: no pixel of the view is the match of two pixels. A pixel without a match is
    /// occluded: it has no disparity and pays the cost of an occlusion. This is Kolmogorov and Zabih's energy
    /// for two images.
    ///
    /// It works with one view only. With several, two pixels of the centre may well have the same match in
    /// one view: one hides the other there, and the hidden one is seen in the opposite view.
    Unique,
    /// Every pixel has a disparity, and pays at most the cost of an occlusion for it. Where it pays that, its
    /// neighbours determine its disparity. Matches need not be unique.
    Capped,
}

impl Occlusion {
    /// All rules.
    pub const ALL: [Occlusion; 2] = [Occlusion::Unique, Occlusion::Capped];

    /// The name on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Occlusion::Unique => "unique",
            Occlusion::Capped => "capped",
        }
    }

    /// The default for a number of views.
    pub fn default_for(views: usize) -> Occlusion {
        if views == 1 { Occlusion::Unique } else { Occlusion::Capped }
    }
}

/// The rule for the cost of neighbours with different labels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothness {
    /// In proportion to the step between their disparities, up to a limit. A pixel next to an occluded one
    /// pays nothing (paper, eq. 6).
    Linear,
    /// The same for every step: once for each disparity that just one of them has, if a view sees both at it
    /// (Kolmogorov and Zabih).
    Potts,
}

impl Smoothness {
    /// All rules.
    pub const ALL: [Smoothness; 2] = [Smoothness::Linear, Smoothness::Potts];

    /// The name on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Smoothness::Linear => "linear",
            Smoothness::Potts => "potts",
        }
    }
}

/// The parameters of graph cuts.
///
/// ```
/// use multiscopic::{GraphCuts, Method, stereo::{Pipeline, cost::BirchfieldTomasi}};
///
/// // The paper's parameters, at half a pixel.
/// let cuts = GraphCuts { upsample: 2, ..GraphCuts::default() };
/// let method = Method::new(Pipeline::GraphCuts { cost: BirchfieldTomasi { color: true }, cuts });
/// # assert!(method != Method::graph_cuts());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct GraphCuts {
    /// The cost of an occlusion in intensities: the paper's K. If `None`, it is found from the images.
    pub occlusion: Option<f64>,
    /// The rule for pixels without a match. If `None`, [it depends](Occlusion::default_for) on the number of views.
    pub occlusions: Option<Occlusion>,
    /// The rule for the cost of neighbours with different labels.
    pub smoothness: Smoothness,
    /// The cost of a step between neighbours that look the same, and between those that look different, in
    /// intensities: the paper's lambda 1 and 2. If `None`, it is that of
    /// [`default_lambda`](GraphCuts::default_lambda).
    pub lambda: [Option<f64>; 2],
    /// The difference in intensity from which on neighbours look different: the paper's theta.
    pub threshold: u8,
    /// The step in disparity above which neighbours pay no more: the paper's d cut-off.
    pub cutoff: u16,
    /// The most by which a disparity that is tried at a pixel differs from one that semi-global matching gives the pixels around
    /// it, at most 8 away. If `None`, it is [that](GraphCuts::default_reach) for the number of views.
    pub reach: Option<u16>,
    /// The most times that all disparities are tried.
    pub sweeps: usize,
    /// The seed of the random order in which disparities are tried.
    pub seed: u64,
    /// True to refine disparities to fractions of a pixel, by the costs of a window.
    pub refine: bool,
    /// True to fill occluded pixels: with the smaller, that is the background's, of the nearest
    /// disparities on both sides along the baseline.
    pub fill: bool,
    /// The factor by which images are enlarged before they are matched, from 1 to
    /// [`MAX_UPSAMPLE`](GraphCuts::MAX_UPSAMPLE). It makes disparities finer.
    pub upsample: u8,
}

impl Default for GraphCuts {
    /// The parameters of the paper.
    fn default() -> GraphCuts {
        GraphCuts {
            occlusion: Some(10.0),
            occlusions: None,
            smoothness: Smoothness::Linear,
            lambda: [None; 2],
            threshold: 8,
            cutoff: 5,
            reach: None,
            sweeps: 20,
            seed: 0,
            refine: true,
            fill: true,
            upsample: 1,
        }
    }
}

impl GraphCuts {
    /// The greatest cost of an occlusion or of a step by one pixel, in intensities. Greater ones are reduced
    /// to it.
    pub const MAX_COST: f64 = 255.0;
    /// The greatest [`cutoff`](GraphCuts::cutoff). Greater ones are reduced to it.
    pub const MAX_STEP: u16 = 511;

    /// The default [`reach`](GraphCuts::reach) for a number of views: 2 for one and 6 for several. With one view, farther
    /// disparities take time, and more of them are worse than better.
    pub const fn default_reach(views: usize) -> u16 {
        if views == 1 { 2 } else { 6 }
    }

    /// The default cost of a step between neighbours that look the same, and between those that look
    /// different.
    ///
    /// - If the cost of an occlusion is found from the images: 3/5 and 1/5 of it (Kolmogorov, Monasse and
    ///   Tan).
    /// - With unique matches: 9 and 3, as in the paper. Steps at occluded pixels are free, and with one view
    ///   most object edges have some.
    /// - With capped occlusions: 3/10 and 1/10 of an occlusion, because every edge pays. This was the best on
    ///   the data sets, and is close to the paper's values in images enlarged four times, where data terms
    ///   weigh 16 times as much and edges only 4 times.
    pub fn default_lambda(&self, occlusions: Occlusion, occlusion: f64) -> [f64; 2] {
        match occlusions {
            _ if self.occlusion.is_none() => [0.6 * occlusion, 0.2 * occlusion],
            Occlusion::Unique => [9.0, 3.0],
            Occlusion::Capped => [0.3 * occlusion, 0.1 * occlusion],
        }
    }

    /// The cost of a step between neighbours that look the same, and between those that look different.
    /// `occlusion` is the cost of an occlusion.
    pub(super) fn weights(&self, occlusions: Occlusion, occlusion: f64) -> [f64; 2] {
        let [same, different] = self.default_lambda(occlusions, occlusion);
        [self.lambda[0].unwrap_or(same), self.lambda[1].unwrap_or(different)]
    }

    /// The greatest factor by which images are enlarged.
    pub const MAX_UPSAMPLE: u8 = 4;
}

/// The label of a pixel: a disparity in pixels, or [`OCCLUDED`].
pub type Label = i16;

/// The label of an occluded pixel.
pub const OCCLUDED: Label = Label::MIN;

/// A pixel of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pixel {
    /// The column.
    pub u: usize,
    /// The row.
    pub v: usize,
    /// The index among all pixels, row by row.
    pub index: usize,
}

impl Pixel {
    /// The pixel at `index` of an image that is `width` pixels wide.
    pub fn new(index: usize, width: usize) -> Pixel {
        Pixel { u: index % width, v: index / width, index }
    }

    /// The pixel in column `u` of row `v` of an image that is `width` pixels wide.
    #[inline(always)]
    pub fn at(u: usize, v: usize, width: usize) -> Pixel {
        Pixel { u, v, index: v * width + u }
    }
}

/// Two neighbouring pixels.
#[derive(Clone, Copy, Debug)]
pub struct NeighborPair {
    /// The left or upper pixel.
    pub first: Pixel,
    /// The right or lower pixel.
    pub second: Pixel,
    /// True if the second pixel lies below the first, false if it lies to its right.
    pub is_vertical: bool,
}
