//! The frames of one capture, in memory.

use std::convert::Infallible;

use image::GrayImage;
use multiscopic_core::{Frame, Rewind, ScanlineSource, View, Views};

/// A centre frame and its neighbours, all of one size, in 8-bit grey.
#[derive(Clone, Debug)]
pub struct Frames {
    center: GrayImage,
    neighbors: [Option<GrayImage>; 4],
}

impl Frames {
    /// The centre alone.
    pub fn new(center: GrayImage) -> Frames {
        Frames { center, neighbors: [const { None }; 4] }
    }

    /// These frames and a neighbour.
    ///
    /// # Panics
    /// If the neighbour's size is not that of the centre.
    pub fn with(mut self, view: View, image: GrayImage) -> Frames {
        assert_eq!(image.dimensions(), self.center.dimensions(), "the size of the {view:?} view");
        self.neighbors[view as usize] = Some(image);
        self
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.center.width() as usize
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.center.height() as usize
    }

    /// The neighbours that there are.
    pub fn views(&self) -> Views {
        View::ALL.into_iter().filter(|&view| self.neighbors[view as usize].is_some()).collect()
    }

    /// An image, if it is there.
    pub fn get(&self, frame: Frame) -> Option<&GrayImage> {
        match frame {
            Frame::Center => Some(&self.center),
            Frame::View(view) => self.neighbors[view as usize].as_ref(),
        }
    }
}

/// Lines in memory: any number of passes may read them, each through its own reference.
impl ScanlineSource for &Frames {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        let image = self.get(frame).expect("the matcher asks for the views of its parameters, which are these");
        line.copy_from_slice(&image.as_raw()[v * self.width()..][..self.width()]);
        Ok(())
    }
}

impl Rewind for &Frames {
    fn rewind(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
