//! The points of a disparity map: what files of point clouds and recordings are made of.

use multiscopic_core::Disparity;

use crate::{
    error::{Error, Result},
    images::{DisparityMap, Geometry, Picture, Raster},
};

/// A disparity map with what makes it a cloud of points.
///
/// Its points are in the frame of the centre camera: x to the right, y down, z along the optical axis.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    /// The disparities.
    pub disparities: &'a DisparityMap,
    /// Their confidences, from 0 to 255; of the size of the disparities.
    pub confidences: Option<&'a Raster<u8>>,
    /// The centre image, which has the colours.
    pub center: &'a Picture,
    /// The camera.
    pub geometry: &'a Geometry,
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
}

impl Cloud<'_> {
    /// Checks that the pixels of all belong together.
    ///
    /// # Errors
    /// [`Error::Usage`] if the centre and the disparities differ in size.
    ///
    /// # Panics
    /// If the confidences and the disparities differ in size.
    pub fn check(&self) -> Result<()> {
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
        Ok(())
    }

    /// Returns the point of every pixel with a finite depth, line by line.
    pub fn points(&self) -> impl Iterator<Item = CloudPoint> {
        let rows = self.disparities.rows().enumerate();
        let pixels = rows.flat_map(|(v, row)| row.iter().enumerate().map(move |(u, &pixel)| (u, v, pixel)));
        pixels.filter_map(|(u, v, pixel)| self.point(u, v, pixel?))
    }

    fn point(&self, u: usize, v: usize, disparity: Disparity) -> Option<CloudPoint> {
        let metres = self.geometry.point(u, v, disparity)?.map(|metres| metres as f32);
        metres.iter().all(|metres| metres.is_finite()).then(|| CloudPoint {
            metres,
            color: self.center.color(u as u32, v as u32),
            confidence: self.confidences.map(|confidences| confidences.get(u, v)),
        })
    }
}
