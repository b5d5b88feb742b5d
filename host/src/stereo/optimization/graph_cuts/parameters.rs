//! The parameters of graph cuts.

/// What becomes of pixels that do not match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// They are occluded, have no disparity and pay the cost of an occlusion; and no pixel of the view is the match of two. This is Kolmogorov
    /// and Zabih's energy of two images.
    ///
    /// It needs one view. With several, two pixels of the centre may well have the same match in a view: one of them hides the other there, and
    /// the other is seen in the opposite view, for which there are several.
    Unique,
    /// They pay no more than the cost of an occlusion for their disparity, which then comes from their neighbours. Matches need not be
    /// unique.
    Capped,
}

impl Occlusion {
    /// Every kind.
    pub const ALL: [Occlusion; 2] = [Occlusion::Unique, Occlusion::Capped];

    /// The name on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Occlusion::Unique => "unique",
            Occlusion::Capped => "capped",
        }
    }

    /// The kind for a number of views.
    pub fn default_for(views: usize) -> Occlusion {
        if views == 1 { Occlusion::Unique } else { Occlusion::Capped }
    }
}

/// What neighbours with different labels pay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothness {
    /// In proportion to the step between their disparities, up to a limit; nothing if one of them is occluded (the paper).
    Linear,
    /// The same for every step, once for each disparity that one has and the other could have but has not (Kolmogorov and Zabih).
    Potts,
}

impl Smoothness {
    /// Every kind.
    pub const ALL: [Smoothness; 2] = [Smoothness::Linear, Smoothness::Potts];

    /// The name on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Smoothness::Linear => "linear",
            Smoothness::Potts => "potts",
        }
    }
}

/// The parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct GraphCuts {
    /// The cost of an occlusion in intensities, the paper's K; `None` if it is found from the images.
    pub occlusion: Option<f64>,
    /// What becomes of pixels that do not match; `None` if it depends on the number of views.
    pub occlusions: Option<Occlusion>,
    /// What neighbours with different labels pay.
    pub smoothness: Smoothness,
    /// The cost of a step between neighbours that look the same and that differ, in intensities: the paper's lambda 1 and 2. `None`: see
    /// [`default_lambda`](GraphCuts::default_lambda).
    pub lambda: [Option<f64>; 2],
    /// From which difference in intensity on neighbours differ: the paper's theta.
    pub threshold: u8,
    /// The step between neighbours above which they pay no more: the paper's d cut-off.
    pub cutoff: u16,
    /// The block size of the block matching that gives the initial labelling: see [`Params`](multiscopic_core::Params).
    pub start_block_size: u8,
    /// At most so many times are all disparities tried.
    pub sweeps: usize,
    /// For the order in which disparities are tried.
    pub seed: u64,
    /// The disparities are moved between whole pixels by the costs of a window around them.
    pub refine: bool,
    /// Occluded pixels take the smaller one, that of what is behind, of the nearest disparities on both sides in the direction of the view.
    pub fill: bool,
    /// The images are matched so many times as large, from 1 to [`MAX_UPSAMPLE`](GraphCuts::MAX_UPSAMPLE), so that disparities are finer.
    pub upsample: u8,
}

impl Default for GraphCuts {
    /// The paper's.
    fn default() -> GraphCuts {
        GraphCuts {
            occlusion: Some(10.0),
            occlusions: None,
            smoothness: Smoothness::Linear,
            lambda: [None; 2],
            threshold: 8,
            cutoff: 5,
            start_block_size: 11,
            sweeps: 20,
            seed: 0,
            refine: true,
            fill: true,
            upsample: 1,
        }
    }
}

impl GraphCuts {
    /// The most that an occlusion or a step of one disparity costs, in intensities; more is the same.
    pub const MAX_COST: f64 = 255.0;
    /// The largest step that is paid for in proportion.
    pub const MAX_STEP: u16 = 511;

    /// The cost of a step between neighbours that look the same and that differ.
    ///
    /// If the cost of an occlusion is found from the images, it is 3/5 and 1/5 of that (Kolmogorov, Monasse and Tan). Otherwise, where matches are
    /// unique, it is 9 and 3 as in the paper. There, steps at occluded pixels are free, and with one view there are such at most edges of things.
    /// Where every pixel has a disparity, each edge pays, so that a step costs 3/10 and 1/10 of an occlusion: what was best on the data sets, and near
    /// to what the paper has where its images are enlarged four times, which gives a pixel's costs 16 times the weight and edges only 4 times.
    pub fn default_lambda(&self, occlusions: Occlusion, occlusion: f64) -> [f64; 2] {
        match occlusions {
            _ if self.occlusion.is_none() => [0.6 * occlusion, 0.2 * occlusion],
            Occlusion::Unique => [9.0, 3.0],
            Occlusion::Capped => [0.3 * occlusion, 0.1 * occlusion],
        }
    }

    /// The cost of a step, if an occlusion costs so much.
    pub(super) fn weights(&self, occlusions: Occlusion, occlusion: f64) -> [f64; 2] {
        let [same, different] = self.default_lambda(occlusions, occlusion);
        [self.lambda[0].unwrap_or(same), self.lambda[1].unwrap_or(different)]
    }

    /// The most times by which images are enlarged.
    pub const MAX_UPSAMPLE: u8 = 4;
}
