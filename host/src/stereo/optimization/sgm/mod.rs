//! Semi-global matching: costs are summed along paths from all sides that charge for changes of disparity.
//!
//! H. Hirschmüller, "Stereo processing by semiglobal matching and mutual information", 2008. The costs are those of the [`Census`]
//! transform, fused over the views first. All of it is whole numbers, and the same on any number of threads and with any vectors.
//!
//! With five paths nothing is kept but a few rows for each thread; with four or eight there is a volume of sums, two bytes for each
//! pixel and disparity, the number of disparities rounded up to a multiple of 32.

mod census;
mod path;
mod sweep;
mod vector;

pub use census::Census;
use census::Costs;
use multiscopic_core::{Frame, Params};
use sweep::{Pass, Row, Sweep};
use vector::LANES;
pub use vector::Vectors;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames},
    progress::Progress,
    stereo::{Engine, cost::Volume},
};

/// From where paths come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paths {
    /// Left, right, top and bottom: two passes.
    Four,
    /// Left, right, and from the top straight and along both diagonals: one pass.
    #[default]
    Five,
    /// All around: two passes.
    Eight,
}

impl Paths {
    /// How many they are.
    pub const fn count(self) -> usize {
        match self {
            Paths::Four => 4,
            Paths::Five => 5,
            Paths::Eight => 8,
        }
    }

    /// The passes that go along them.
    fn passes(self) -> Vec<Pass> {
        let diagonals = self != Paths::Four;
        let down = Pass { upwards: false, along_rows: true, diagonals };
        let up = Pass { upwards: true, along_rows: false, diagonals };
        if self == Paths::Five { vec![down] } else { vec![down, up] }
    }
}

/// Semi-global matching, with what it charges. Every value of this type is valid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SemiGlobal {
    census: Census,
    paths: Paths,
    p1: u16,
    p2: u16,
    p2_edge: Option<u8>,
    left_right: Option<u16>,
}

// Twelve is the largest scale of a fusion, and a path costs at most a cost and P2.
const _: () = assert!(8 * 12 * (SemiGlobal::MAX_PENALTY as u32 + Census::MAX_COST as u32) < u16::MAX as u32);

impl Default for SemiGlobal {
    fn default() -> SemiGlobal {
        let census = Census::default();
        let [p1, p2] = SemiGlobal::default_penalties(census);
        SemiGlobal { census, paths: Paths::default(), p1, p2, p2_edge: Some(SemiGlobal::DEFAULT_P2_EDGE), left_right: None }
    }
}

impl SemiGlobal {
    /// The greatest penalty: the sums of eight paths on the scale of any fusion stay below what 16 bits hold.
    pub const MAX_PENALTY: u16 = 650;

    /// The change of brightness above which P2 is lowered, unless it is said otherwise.
    pub const DEFAULT_P2_EDGE: u8 = 10;

    /// P1 and P2 for a census: a quarter of its bits, and six times that.
    pub const fn default_penalties(census: Census) -> [u16; 2] {
        let p1 = (census.bits() as u16 + 2) / 4;
        [p1, 6 * p1]
    }

    /// With the penalties `p1` for a change by one disparity from a pixel to the next on a path, and `p2` for any other. They are in bits
    /// of the census, whatever the fusion.
    ///
    /// Where the brightness changes by more than `p2_edge` from a pixel to the next, `p2` is lowered in inverse proportion, to `p2 *
    /// p2_edge / change` rounded down, but not below `p1`.
    ///
    /// Where `left_right` is given, a disparity is kept only if a view confirms it within that many pixels: see
    /// [`Volume::check_left_right`]. This takes the volume of sums.
    ///
    /// # Errors
    /// If `p2` is below `p1` or above [`MAX_PENALTY`](SemiGlobal::MAX_PENALTY).
    pub fn new(
        census: Census,
        paths: Paths,
        [p1, p2]: [u16; 2],
        p2_edge: Option<u8>,
        left_right: Option<u16>,
    ) -> Result<SemiGlobal> {
        if p1 > p2 || p2 > SemiGlobal::MAX_PENALTY {
            let most = SemiGlobal::MAX_PENALTY;
            return Err(Error::Usage(format!("P1 is {p1} and P2 is {p2}, it must be P1 <= P2 <= {most}")));
        }
        Ok(SemiGlobal { census, paths, p1, p2, p2_edge, left_right })
    }

    /// P2 by the change of brightness.
    fn p2(&self, change: u8) -> u16 {
        match self.p2_edge {
            Some(edge) if change > edge => (u32::from(self.p2) * u32::from(edge) / u32::from(change)).max(self.p1.into()) as u16,
            _ => self.p2,
        }
    }

    /// Estimates the disparities of the centre of `frames` with the views of `params`, whose block size is not used.
    ///
    /// # Panics
    /// If `params` were made for frames of another size or with views that are not there.
    pub fn disparities(&self, engine: &Engine, frames: &Frames, params: &Params, progress: &dyn Progress) -> DisparityMap {
        assert_eq!((frames.width(), frames.height()), (params.width(), params.height()), "the size of the frames");
        let costs = engine.pool().install(|| Costs::new(frames, params, self.census));
        // On the scale of the fused costs.
        let scale = params.fusion().scale() as u16;
        let sweep = Sweep {
            params,
            costs: &costs,
            center: frames.get(Frame::Center).expect("there always is"),
            p1: scale * self.p1,
            p2: std::array::from_fn(|change| scale * self.p2(change as u8)),
            lanes: params.num_disparities().next_multiple_of(LANES),
            progress,
        };
        let (width, height) = (params.width(), params.height());
        let passes = self.paths.passes();
        progress.begin((height * passes.len()) as u64, "lines");
        let is_kept = passes.len() > 1 || self.left_right.is_some();
        let mut sums = is_kept.then(|| Volume::filled(width, height, sweep.lanes, 0));
        let mut map = DisparityMap::filled(width, height, None);
        for (i, &pass) in passes.iter().enumerate() {
            let is_last = i + 1 == passes.len();
            let mut of_rows = sums.iter_mut().flat_map(Volume::rows_mut);
            let mut rows: Vec<Row> = map
                .rows_mut()
                .enumerate()
                .map(|(v, disparities)| Row { v, sums: of_rows.next(), disparities: is_last.then_some(disparities) })
                .collect();
            if pass.upwards {
                rows.reverse();
            }
            sweep.run(pass, rows, engine.simd(params), engine.threads());
        }
        if let (Some(tolerance), Some(sums)) = (self.left_right, &sums) {
            sums.check_left_right(params, &mut map, tolerance);
        }
        map
    }
}
