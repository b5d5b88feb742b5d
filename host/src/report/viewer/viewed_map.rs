//! A disparity map on a page.

use crate::{
    evaluation::{Metrics, Reduction},
    images::{DisparityMap, Raster},
};

use super::block_costs::BlockCosts;

/// A disparity map, and what is known of it.
#[derive(Clone, Debug)]
pub struct ViewedMap<'a> {
    /// The name, such as that of its method.
    pub name: String,
    /// The disparities.
    pub disparities: &'a DisparityMap,
    /// The confidences: probabilities times 255.
    pub confidences: Option<&'a Raster<u8>>,
    /// The errors. The scene computes them if it has the truth.
    pub metrics: Option<Metrics>,
    /// How much smaller the errors are than those of stereo.
    pub reduction: Option<Reduction>,
    /// Names and values of parameters.
    pub parameters: Vec<(String, String)>,
    /// The costs to show at a pixel.
    pub costs: Option<BlockCosts>,
    /// The file with the disparities, relative to the page.
    pub file: Option<String>,
}
