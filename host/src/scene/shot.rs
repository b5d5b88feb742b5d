//! The frames that a simulated capture gives.

use image::RgbImage;
use multiscopic_core::{Frame, Views};

use super::pinhole_camera::place;
use crate::images::{FloatImage, Frames, Picture};

/// Five rendered frames and the true disparities of the centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The centre frame, which is the reference.
    pub center: RgbImage,
    /// The neighbours, in the order of [`View::CROSS`](multiscopic_core::View::CROSS).
    pub neighbors: [RgbImage; 4],
    /// The true disparity of every centre pixel, in pixels at the nominal baseline. It is that of the point
    /// which the ray through the pixel's centre meets, and infinite if there is none.
    pub truth: FloatImage,
}

impl Shot {
    /// One of the five frames.
    ///
    /// # Panics
    /// If it is none of them.
    pub fn frame(&self, frame: Frame) -> &RgbImage {
        match frame {
            Frame::Center => &self.center,
            Frame::View(view) => &self.neighbors[place(view)],
        }
    }

    /// The centre and the neighbours `views`, in grey, ready for matching.
    ///
    /// # Panics
    /// If a view is none of [`View::CROSS`](multiscopic_core::View::CROSS).
    pub fn frames(&self, views: Views) -> Frames {
        let gray = |frame| Picture::Rgb(self.frame(frame).clone()).to_gray();
        views.iter().fold(Frames::new(gray(Frame::Center)), |frames, view| frames.with(view, gray(Frame::View(view))))
    }
}
