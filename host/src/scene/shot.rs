//! The frames that a simulated capture gives.

use std::collections::BTreeMap;

use image::RgbImage;
use multiscopic_core::{Frame, View, Views};

use crate::images::{FloatImage, Frames, Picture};

/// Rendered frames and the true disparities of the centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The centre frame, which is the reference.
    pub center: RgbImage,
    /// The neighbours.
    pub neighbors: BTreeMap<View, RgbImage>,
    /// The true disparity of every centre pixel, in pixels at the nominal baseline. It is that of the point
    /// which the ray through the pixel's centre meets, and infinite if there is none.
    pub truth: FloatImage,
}

impl Shot {
    /// One of the frames.
    ///
    /// # Panics
    /// If it was not rendered.
    pub fn frame(&self, frame: Frame) -> &RgbImage {
        match frame {
            Frame::Center => &self.center,
            Frame::View(view) => &self.neighbors[&view],
        }
    }

    /// The centre and all neighbours with their colours, ready for matching.
    pub fn color_frames(&self) -> Frames {
        let picture = |image: &RgbImage| Picture::Rgb(image.clone());
        let center = Frames::of_picture(picture(&self.center));
        self.neighbors.iter().fold(center, |frames, (view, image)| frames.with_picture(*view, picture(image)))
    }

    /// The centre and the neighbours `views`, in grey, ready for matching.
    ///
    /// # Panics
    /// If a view was not rendered.
    pub fn frames(&self, views: Views) -> Frames {
        let gray = |frame| Picture::Rgb(self.frame(frame).clone()).to_gray();
        views.iter().fold(Frames::new(gray(Frame::Center)), |frames, view| frames.with(view, gray(Frame::View(view))))
    }
}
