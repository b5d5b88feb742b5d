//! The points of a disparity map: what files of point clouds and recordings are made of.

use multiscopic_core::Disparity;
use nalgebra::{Isometry3, Point3};

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Edges, FloatImage, FrameTree, Geometry, Picture, PointFrame, Raster, Transform, between_surfaces},
};

/// A disparity map with what makes it a cloud of points, in any frame that is known.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    /// The disparities.
    pub disparities: &'a DisparityMap,
    /// Their confidences, from 0 to 255; of the size of the disparities.
    pub confidences: Option<&'a Raster<u8>>,
    /// Their standard deviations of depth in metres; of the size of the disparities.
    pub deviations: Option<&'a FloatImage>,
    /// The fate of points between two surfaces.
    pub edges: Edges,
    /// The centre image, which has the colours.
    pub center: &'a Picture,
    /// The camera.
    pub geometry: &'a Geometry,
    /// The frame of the points.
    pub frame: PointFrame,
    /// The places of the frames.
    pub frames: FrameTree,
}

/// A point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// The place in metres.
    pub metres: [f32; 3],
    /// The colour: red, green, blue.
    pub color: [u8; 3],
    /// The confidence from 0 to 255, if the cloud has confidences.
    pub confidence: Option<u8>,
    /// The standard deviation of the depth in metres, if the cloud has deviations.
    pub sigma: Option<f32>,
}

impl<'a> Cloud<'a> {
    /// The points of disparities in the frame of the camera, without those between two surfaces.
    pub fn new(disparities: &'a DisparityMap, center: &'a Picture, geometry: &'a Geometry) -> Cloud<'a> {
        let (frame, frames) = (PointFrame::Camera, FrameTree::default());
        Cloud { disparities, confidences: None, deviations: None, edges: Edges::Drop, center, geometry, frame, frames }
    }

    /// Checks that the pixels of all belong together.
    ///
    /// # Errors
    /// [`Error::Usage`] if the centre and the disparities differ in size, or the frame of the points is not known.
    ///
    /// # Panics
    /// If the confidences or deviations and the disparities differ in size.
    pub fn check(&self) -> Result<()> {
        if self.frames.from_rectified(self.frame).is_none() {
            return Err(Error::Usage(format!("it is not known where the frame {} of the points is", self.frame.name())));
        }
        let size = (self.disparities.width(), self.disparities.height());
        let (width, height) = size;
        let (w, h) = self.center.dimensions();
        if (w as usize, h as usize) != size {
            return Err(Error::Usage(format!(
                "the centre image has {w}x{h} pixels, the disparities {width}x{height}: use the image that was matched"
            )));
        }
        if let Some(confidences) = self.confidences {
            assert_eq!((confidences.width(), confidences.height()), size, "the size of the confidences");
        }
        if let Some(deviations) = self.deviations {
            assert_eq!((deviations.width(), deviations.height()), size, "the size of the deviations");
        }
        Ok(())
    }

    /// Returns the point of every pixel that has a finite depth and is not between two surfaces, line by line.
    pub fn points(&self) -> impl Iterator<Item = CloudPoint> {
        self.pixels().flatten()
    }

    /// Returns every pixel, line by line, with its point if it has one.
    pub fn pixels(&self) -> impl Iterator<Item = Option<CloudPoint>> {
        // Points of a camera that needs no rectification stay as they are, to the last bit.
        let transform = self.frames.from_rectified(self.frame).filter(|transform| *transform != Transform::IDENTITY);
        let transform = transform.map(|transform| transform.isometry());
        let dropped = (self.edges == Edges::Drop).then(|| between_surfaces(self.disparities));
        let rows = self.disparities.rows().enumerate();
        let pixels = rows.flat_map(|(v, row)| row.iter().enumerate().map(move |(u, &pixel)| (u, v, pixel)));
        pixels.map(move |(u, v, pixel)| {
            let is_dropped = dropped.as_ref().is_some_and(|dropped| dropped.get(u, v));
            if is_dropped { None } else { self.point(u, v, pixel?, transform.as_ref()) }
        })
    }

    fn point(&self, u: usize, v: usize, disparity: Disparity, transform: Option<&Isometry3<f64>>) -> Option<CloudPoint> {
        let point = self.geometry.point(u, v, disparity)?;
        let metres = match transform {
            None => point,
            Some(transform) => (transform * Point3::from(point.map(|metres| 1000.0 * metres)) / 1000.0).into(),
        };
        let metres = metres.map(|metres: f64| metres as f32);
        metres.iter().all(|metres| metres.is_finite()).then(|| CloudPoint {
            metres,
            color: self.center.color(u as u32, v as u32),
            confidence: self.confidences.map(|confidences| confidences.get(u, v)),
            sigma: self.deviations.map(|deviations| deviations.get(u, v)),
        })
    }
}
