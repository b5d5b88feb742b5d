//! Semi-global matching: costs are summed along paths from all sides, which charge for changes of disparity.
//!
//! The step along a path, the selection and their arithmetic are the core's:
//! [`SemiGlobalParams`](multiscopic_core::SemiGlobalParams) defines them. With five paths the result is that of
//! [`SemiGlobalMatcher`](multiscopic_core::SemiGlobalMatcher), bit for bit, whatever the threads and the vector
//! instructions: see `wavefront`. Each thread keeps a few rows. With four or eight paths, there is a volume
//! of sums: two bytes for each pixel and disparity.
//!
//! | module | what it is |
//! | --- | --- |
//! | `row_sweep` | the paths through a row, and those of a few columns, as a row sends them to the next |
//! | `wavefront` | a pass over the rows, on several threads |

mod row_sweep;
mod wavefront;

use multiscopic_core::{PathPenalties, SemiGlobalCost};

use crate::{
    cost::{CostRows, Volume},
    disparity_map::DisparityMap,
    engine::Engine,
    progress::Progress,
    raster::Raster,
};
use row_sweep::{Pass, RowTask};
use wavefront::Wavefront;

/// Semi-global matching: its paths and their penalties. Every value of this type is valid.
///
/// Start from [`default_for`](SemiGlobal::default_for) with the cost and the number of views. Then call
/// [`optimize`](SemiGlobal::optimize) with fused [costs](CostRows) to select disparities.
///
/// ```
/// use multiscopic_core::{Census, Fusion, SearchConfig, SemiGlobalCost, View, Views};
/// use multiscopic_engine::{Engine, Planes, cost::CensusRows, sgm::SemiGlobal};
///
/// // Random texture, two pixels further to the left in the right view.
/// let texture = |u: usize, v: usize| ((u * 2654435761 + v * 40503) >> 7) as u8;
/// let image = |shift: usize| (0..64 * 32).map(|i| texture(i % 64 + shift, i / 64)).collect::<Vec<u8>>();
/// let (center, right) = (image(0), image(2));
/// let frames = Planes::new([64, 32], &center).with(View::RIGHT, &right);
///
/// let search = SearchConfig { views: Views::STEREO, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(64, 32) };
/// let (engine, search) = (Engine::default(), search.checked()?);
/// let costs = CensusRows::new(&frames, &search, Census::default(), &engine);
/// let sgm = SemiGlobal::default_for(SemiGlobalCost::Census(Census::default()), 1);
/// let (map, _) = sgm.optimize(&costs, &center, &engine, false, None, &());
/// assert_eq!(map.get(40, 16).map(f32::from), Some(2.0));
/// # Ok::<(), multiscopic_engine::EngineError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SemiGlobal {
    /// The sides that paths come from.
    pub paths: Paths,
    /// The penalties for changes of disparity along the paths, in units of the matching cost, whatever the fusion.
    pub penalties: PathPenalties,
}

impl SemiGlobal {
    /// Five paths, and the penalties that suit a cost, fused over a number of views.
    pub fn default_for(cost: SemiGlobalCost, views: usize) -> SemiGlobal {
        SemiGlobal { paths: Paths::default(), penalties: cost.default_penalties(views) }
    }

    /// Sums the costs of `rows` along the paths and selects the disparities of least sum. The edges of the image `center` lower
    /// P2.
    /// `peaks` receives the peak ratios, if it is given. If `keep_sums` is set, the sums are returned too: a volume of two bytes
    /// for each pixel and disparity, which several passes take anyway.
    pub fn optimize(
        &self,
        rows: &dyn CostRows<Cost = u8>,
        center: &[u8],
        engine: &Engine,
        keep_sums: bool,
        mut peaks: Option<&mut Raster<u8>>,
        progress: &dyn Progress,
    ) -> (DisparityMap, Option<Volume<u16>>) {
        let search = rows.search();
        let (width, height) = (search.width(), search.height());
        let wavefront = Wavefront {
            costs: rows,
            center,
            p1: self.penalties.p1(),
            p2: std::array::from_fn(|change| self.penalties.p2(change as u8)),
            stride: search.num_disparities().next_multiple_of(engine.simd(search).lanes()),
            paths: self.paths.count() as u16,
            progress,
        };
        let passes = self.paths.passes();
        progress.begin((height * passes.len()) as u64, "lines");
        let mut sums = (keep_sums || passes.len() > 1).then(|| Volume::filled(width, height, wavefront.stride, 0));
        let mut map = DisparityMap::filled(width, height, None);
        for (i, &pass) in passes.iter().enumerate() {
            let is_last = i + 1 == passes.len();
            let mut sums_of_rows = sums.iter_mut().flat_map(Volume::rows_mut);
            let mut peaks_of_rows = peaks.as_deref_mut().filter(|_| is_last).into_iter().flat_map(Raster::rows_mut);
            let mut rows: Vec<RowTask> = map
                .rows_mut()
                .enumerate()
                .map(|(v, disparities)| RowTask {
                    v,
                    sums: sums_of_rows.next(),
                    disparities: is_last.then_some(disparities),
                    peaks: peaks_of_rows.next(),
                })
                .collect();
            if pass.upwards {
                rows.reverse();
            }
            wavefront.run(pass, rows, engine);
        }
        (map, sums.filter(|_| keep_sums))
    }
}

/// The sides that paths come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paths {
    /// Left, right, top and bottom, in two passes.
    Four,
    /// Left, right, and from the top straight and along both diagonals, in one pass. These are the core's.
    #[default]
    Five,
    /// All eight sides, in two passes.
    Eight,
}

impl Paths {
    /// All sets of paths.
    pub const ALL: [Paths; 3] = [Paths::Four, Paths::Five, Paths::Eight];

    /// The number of paths.
    pub const fn count(self) -> usize {
        match self {
            Paths::Four => 4,
            Paths::Five => 5,
            Paths::Eight => 8,
        }
    }

    /// The passes over the image that go along these paths.
    fn passes(self) -> Vec<Pass> {
        let diagonals = self != Paths::Four;
        let down = Pass { upwards: false, along_rows: true, diagonals };
        let up = Pass { upwards: true, along_rows: false, diagonals };
        if self == Paths::Five { vec![down] } else { vec![down, up] }
    }
}
