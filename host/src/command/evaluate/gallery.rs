//! The pictures of a scene on the page.

use std::ops::RangeInclusive;

use multiscopic::{
    DisparityMap, FloatImage, Picture,
    report::{Figure, error_map},
};

/// The pictures of a scene, for which all maps share the colour scale of its truth.
pub struct Gallery {
    truth: FloatImage,
    range: Option<RangeInclusive<f32>>,
    figures: Vec<Figure>,
}

impl Gallery {
    /// The centre and the truth.
    pub fn new(center: &Picture, truth: FloatImage) -> Gallery {
        let map = DisparityMap::from_float(&truth);
        let range = map.range();
        let figures =
            vec![Figure::embedded("centre", center.to_rgb()), Figure::embedded("true disparities", map.to_color(range.clone()))];
        Gallery { truth, range, figures }
    }

    /// Adds the disparities and the error map of a variant.
    pub fn add(&mut self, variant: &str, disparities: &DisparityMap) {
        let estimates = disparities.pixels().iter().map(|d| d.map(f32::from));
        let errors = error_map::draw(estimates, &self.truth);
        self.figures.push(Figure::embedded(variant, disparities.to_color(self.range.clone())));
        self.figures.push(Figure::embedded(format!("errors of {variant}"), errors));
    }

    /// The pictures.
    pub fn into_figures(self) -> Vec<Figure> {
        self.figures
    }
}
