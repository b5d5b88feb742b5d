//! The options of MC-CNN.

use clap::Args;
use multiscopic::stereo::{
    aggregation::{Aggregation, SupportRegion},
    cost::mccnn::Architecture,
    optimization::edge_aware::Penalties,
};

use crate::value::positive;

/// The options of `--method mccnn-fast` and `mccnn-accurate`, named as by the authors of MC-CNN.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "MC-CNN (--method mccnn-fast or mccnn-accurate; defaults for Middlebury)")]
pub(crate) struct McCnnOptions {
    /// Penalty for a disparity change of one between neighbouring pixels (sgm_P1) [default: 2.3 fast, 1.3 accurate]
    #[arg(long, value_name = "COST", value_parser = positive)]
    sgm_p1: Option<f64>,

    /// Penalty for larger changes (sgm_P2) [default: 55.9 fast, 18.1 accurate]
    #[arg(long, value_name = "COST", value_parser = positive)]
    sgm_p2: Option<f64>,

    /// Divisor of both penalties at an edge in one image (sgm_Q1) [default: 4 fast, 4.5 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_q1: Option<f64>,

    /// Divisor of both penalties at an edge in both images (sgm_Q2) [default: 8 fast, 9 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_q2: Option<f64>,

    /// Further divisor of the first penalty on vertical paths (sgm_V) [default: 1.5 fast, 2.75 accurate]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    sgm_v: Option<f64>,

    /// Brightness difference between neighbouring pixels that makes an edge, in standard deviations of the image (sgm_D)
    /// [default: 0.08 fast, 0.13 accurate]
    #[arg(long, value_name = "N", value_parser = positive)]
    sgm_d: Option<f64>,

    /// Average costs over a cross of pixels that differ in brightness by less than this, in standard deviations of the image
    #[arg(long, value_name = "N", default_value_t = decimal(SupportRegion::ACCURATE.intensity), value_parser = positive)]
    cbca_intensity: f64,

    /// Limit the arms of that cross to less than this many pixels
    #[arg(long, value_name = "N", default_value_t = SupportRegion::ACCURATE.distance)]
    cbca_distance: u16,

    /// Number of averaging passes before the paths (cbca_num_iterations_1) [default: 0 fast, 2 accurate]
    #[arg(long, value_name = "N")]
    cbca_iterations_1: Option<usize>,

    /// Number of averaging passes after the paths (cbca_num_iterations_2) [default: 0]
    #[arg(long, value_name = "N")]
    cbca_iterations_2: Option<usize>,
}

/// The number that a default is written as, without the digits that its precision does not have.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().expect("a number as it is written")
}

impl McCnnOptions {
    /// Returns the aggregation.
    pub(crate) fn aggregation(&self, architecture: Architecture) -> Aggregation {
        let [before, after] = architecture.iterations();
        Aggregation {
            region: SupportRegion { intensity: self.cbca_intensity as f32, distance: self.cbca_distance },
            iterations: [self.cbca_iterations_1.unwrap_or(before), self.cbca_iterations_2.unwrap_or(after)],
        }
    }

    /// Returns the penalties of the paths.
    pub(crate) fn penalties(&self, architecture: Architecture) -> Penalties {
        let Penalties { p1, p2, q1, q2, vertical, edge } = match architecture {
            Architecture::Fast => Penalties::FAST,
            Architecture::Accurate => Penalties::ACCURATE,
        };
        let or = |given: Option<f64>, default: f32| given.map_or(default, |given| given as f32);
        Penalties {
            p1: or(self.sgm_p1, p1),
            p2: or(self.sgm_p2, p2),
            q1: or(self.sgm_q1, q1),
            q2: or(self.sgm_q2, q2),
            vertical: or(self.sgm_v, vertical),
            edge: or(self.sgm_d, edge),
        }
    }
}
