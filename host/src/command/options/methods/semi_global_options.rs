//! The options of semi-global matching.

use clap::Args;
use multiscopic::{
    Error, Result, SemiGlobal,
    stereo::{cost::Census, optimization::sgm::Paths},
};

use crate::command::options::named::{Named, named};

/// The options of `--method sgm`.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Semi-global matching (--method sgm)")]
pub struct SemiGlobalOptions {
    /// Penalty for a disparity change of one between neighbouring pixels, in census bits (OpenCV: P1)
    /// [default: a quarter of the window's bits, 8 for 9x7]
    #[arg(long, visible_alias = "P1", value_name = "N")]
    p1: Option<u16>,

    /// Penalty for larger changes, from P1 to 650 (OpenCV: P2) [default: 6 times P1, 48 for 9x7]
    #[arg(long, visible_alias = "P2", value_name = "N")]
    p2: Option<u16>,

    /// Lower P2 where neighbouring pixels differ in brightness by more than this, in inverse proportion to the difference,
    /// but not below P1; 255 turns this off
    #[arg(long, value_name = "N", default_value_t = SemiGlobal::DEFAULT_P2_EDGE)]
    p2_edge: u8,

    /// Number of paths: 4, 5 or 8 (OpenCV: MODE_HH4, MODE_SGBM or MODE_HH); 4 and 8 keep all costs in memory
    #[arg(long, value_name = "4|5|8", default_value = "5", value_parser = paths)]
    paths: Paths,

    /// Window of the census transform
    #[arg(long, value_name = "SIZE", value_parser = named::<Census>(), default_value = "9x7")]
    pub census: Census,
}

impl SemiGlobalOptions {
    /// The optimizer.
    pub fn semi_global(&self) -> Result<SemiGlobal> {
        let p1 = self.p1.unwrap_or(self.census.default_penalties()[0]);
        let p2 = self.p2.unwrap_or(p1.saturating_mul(6).min(SemiGlobal::MAX_PENALTY));
        SemiGlobal::new(self.paths, [p1, p2], Some(self.p2_edge))
    }
}

fn paths(text: &str) -> Result<Paths> {
    let all = [Paths::Four, Paths::Five, Paths::Eight];
    let paths = all.into_iter().find(|paths| paths.count().to_string() == text);
    paths.ok_or_else(|| Error::Usage("it must be 4, 5 or 8".into()))
}

impl Named for Census {
    const ALL: &'static [Census] = &Census::ALL;

    fn name(&self) -> &'static str {
        Census::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Census::Window5x5 => "5 x 5 pixels, 12 bits",
            Census::Window7x7 => "7 x 7 pixels, 24 bits",
            Census::Window9x7 => "9 x 7 pixels, 31 bits",
        }
    }
}
