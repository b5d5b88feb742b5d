//! Semi-global matching: costs are summed along paths from all sides, which charge for changes of disparity.
//!
//! H. Hirschmüller, "Stereo processing by semiglobal matching and mutual information", 2008. All arithmetic
//! is in whole numbers: the bits do not depend on the threads or the vector instructions.
//!
//! With five paths, each thread keeps a few rows. With four or eight paths, there is a volume of sums: two
//! bytes for each pixel and disparity, the number of disparities rounded up to a multiple of [`LANES`].

mod path;
mod semi_global;
mod wavefront;

pub use semi_global::{Paths, SemiGlobal};

use image::GrayImage;
use wavefront::{Pass, RowTask, Wavefront};

use crate::{
    error::Result,
    images::DisparityMap,
    progress::Progress,
    stereo::{
        cost::{CostRows, Volume},
        engine::Engine,
        lanes::LANES,
    },
};

impl Paths {
    /// The passes over the image that go along these paths.
    fn passes(self) -> Vec<Pass> {
        let diagonals = self != Paths::Four;
        let down = Pass { upwards: false, along_rows: true, diagonals };
        let up = Pass { upwards: true, along_rows: false, diagonals };
        if self == Paths::Five { vec![down] } else { vec![down, up] }
    }
}

impl SemiGlobal {
    /// Selects disparities by the sums of path costs. `center` is the image whose edges lower P2. Also
    /// returns the sums if `keep_sums` is set, which takes the volume that several passes take.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage) if the sums could leave 16 bits: see [`SemiGlobal::check_sums`].
    pub fn optimize<R: CostRows<Cost = u16>>(
        &self,
        rows: &R,
        center: &GrayImage,
        engine: &Engine,
        keep_sums: bool,
        progress: &dyn Progress,
    ) -> Result<(DisparityMap, Option<Volume<u16>>)> {
        let search = rows.search();
        self.check_sums(rows.max_cost(), search.fusion())?;
        let scale = search.fusion().scale() as u16;
        let wavefront = Wavefront {
            costs: rows,
            center,
            p1: scale * self.p1(),
            p2: std::array::from_fn(|change| scale * self.p2(change as u8)),
            stride: search.num_disparities().next_multiple_of(LANES),
            progress,
        };
        let (width, height) = (search.width(), search.height());
        let passes = self.paths().passes();
        progress.begin((height * passes.len()) as u64, "lines");
        let mut sums = (keep_sums || passes.len() > 1).then(|| Volume::filled(width, height, wavefront.stride, 0));
        let mut map = DisparityMap::filled(width, height, None);
        for (i, &pass) in passes.iter().enumerate() {
            let is_last = i + 1 == passes.len();
            let mut sums_of_rows = sums.iter_mut().flat_map(Volume::rows_mut);
            let mut rows: Vec<RowTask> = map
                .rows_mut()
                .enumerate()
                .map(|(v, disparities)| RowTask { v, sums: sums_of_rows.next(), disparities: is_last.then_some(disparities) })
                .collect();
            if pass.upwards {
                rows.reverse();
            }
            wavefront.run(pass, rows, engine);
        }
        Ok((map, sums.filter(|_| keep_sums)))
    }
}
