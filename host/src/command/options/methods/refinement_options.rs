//! The options of refinement: checks and filters of the selected disparities.

use clap::Args;
use multiscopic::{
    Result,
    stereo::refinement::{Bilateral, Median, Refinement},
};

use crate::command::options::value::point;

/// The filters, which all methods but block matching apply.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Filters (not for --method bm)")]
pub struct RefinementOptions {
    /// Keep a disparity only if a view confirms it to within this many pixels; not for gc (OpenCV: disp12MaxDiff)
    /// [default: keep all]
    #[arg(long, value_name = "N")]
    disp12_max_diff: Option<u16>,

    /// Median filter with a window of this size, odd, from 3 to 31 pixels [default: none]
    #[arg(long, value_name = "N")]
    median: Option<u8>,

    /// Bilateral filter: mean of the disparities that differ by less than THRESHOLD, weighted by a Gaussian of SIGMA pixels
    /// [default: none]
    #[arg(long, value_name = "SIGMA,THRESHOLD", value_parser = point)]
    bilateral: Option<[f64; 2]>,
}

impl RefinementOptions {
    /// The refinement.
    pub fn refinement(&self) -> Result<Refinement> {
        Ok(Refinement {
            left_right: self.disp12_max_diff,
            median: self.median.map(Median::new).transpose()?,
            bilateral: self.bilateral.map(|[sigma, threshold]| Bilateral::new(sigma, threshold)).transpose()?,
        })
    }
}
