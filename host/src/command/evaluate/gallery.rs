//! The pictures of a scene on the page.

use std::ops::RangeInclusive;

use image::RgbImage;
use multiscopic::{
    DisparityMap, FloatImage, Picture,
    report::{Figure, error_map},
};

/// The pictures of a scene, for which all maps share the colour scale of its truth, if that is known.
pub struct Gallery {
    truth: Option<FloatImage>,
    range: Option<RangeInclusive<f32>>,
    figures: Vec<Figure>,
}

impl Gallery {
    /// The centre and the truth.
    pub fn new(center: &Picture, truth: Option<FloatImage>) -> Gallery {
        let map = truth.as_ref().map(DisparityMap::from_float);
        let range = map.as_ref().and_then(DisparityMap::range);
        let mut figures = vec![Figure::embedded("centre", center.to_rgb())];
        figures.extend(map.map(|map| Figure::embedded("true disparities", map.to_color(range.clone()))));
        Gallery { truth, range, figures }
    }

    /// Adds the disparities and the error map of a variant.
    pub fn add(&mut self, variant: &str, disparities: &DisparityMap) {
        self.figures.push(Figure::embedded(variant, disparities.to_color(self.range.clone())));
        let errors = self.truth.as_ref().map(|truth| errors(disparities, truth));
        self.figures.extend(errors.map(|errors| Figure::embedded(format!("errors of {variant}"), errors)));
    }

    /// Adds how far the disparities of a variant are from those of the plane that fits them best.
    pub fn add_plane(&mut self, variant: &str, disparities: &DisparityMap, plane: &FloatImage) {
        self.figures.push(Figure::embedded(format!("distance of {variant} from the plane"), errors(disparities, plane)));
    }

    /// The pictures.
    pub fn into_figures(self) -> Vec<Figure> {
        self.figures
    }
}

fn errors(disparities: &DisparityMap, truth: &FloatImage) -> RgbImage {
    error_map::draw(disparities.pixels().iter().map(|d| d.map(f32::from)), truth)
}
