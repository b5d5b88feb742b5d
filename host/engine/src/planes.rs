//! The grey frames of a set, borrowed from whoever has the images.

use std::convert::Infallible;

use multiscopic_core::{Frame, Rewind, ScanlineSource, View};

/// The grey frames of a set: a centre and its neighbours, all of the same size, one byte per pixel, row by row from the top.
///
/// Start with the centre in [`new`](Planes::new) and add each neighbour by [`with`](Planes::with). The network also looks at
/// colours, if [`with_color`](Planes::with_color) adds them. Pixels are borrowed, so a copy costs as much as a few pointers.
#[derive(Clone, Debug)]
pub struct Planes<'a> {
    size: [usize; 2],
    center: &'a [u8],
    neighbors: Vec<(View, &'a [u8])>,
    /// The colours of the centre, three bytes for each pixel.
    color: Option<&'a [u8]>,
}

impl<'a> Planes<'a> {
    /// A centre of `[width, height]` pixels, without neighbours.
    ///
    /// # Panics
    /// If a side is 0, or `center` does not have as many bytes as pixels.
    pub fn new(size: [usize; 2], center: &'a [u8]) -> Planes<'a> {
        let [width, height] = size;
        assert!(!center.is_empty() && center.len() == width * height, "{} bytes for {width}x{height} pixels", center.len());
        Planes { size, center, neighbors: Vec::new(), color: None }
    }

    /// Adds the grey pixels of a neighbour, or replaces them.
    ///
    /// # Panics
    /// If it does not have as many bytes as the centre.
    pub fn with(mut self, view: View, pixels: &'a [u8]) -> Planes<'a> {
        assert_eq!(pixels.len(), self.center.len(), "the size of the {view} view");
        self.neighbors.retain(|(other, _)| *other != view);
        self.neighbors.push((view, pixels));
        self
    }

    /// Adds the colours of the centre, three bytes for each pixel: the network looks for edges in them.
    ///
    /// # Panics
    /// If there are not three bytes for each pixel.
    pub fn with_color(self, color: &'a [u8]) -> Planes<'a> {
        assert_eq!(color.len(), 3 * self.center.len(), "the size of the centre in colour");
        Planes { color: Some(color), ..self }
    }

    /// The width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The pixels of the centre.
    pub fn center(&self) -> &'a [u8] {
        self.center
    }

    /// The colours of the centre, if they are known.
    pub fn color(&self) -> Option<&'a [u8]> {
        self.color
    }

    /// The pixels of a frame, or `None` if it is missing.
    pub fn get(&self, frame: Frame) -> Option<&'a [u8]> {
        match frame {
            Frame::Center => Some(self.center),
            Frame::View(view) => self.neighbors.iter().find(|(other, _)| *other == view).map(|(_, pixels)| *pixels),
        }
    }
}

/// Each reference is a source of its own, so several passes can read the same frames at once.
impl ScanlineSource for &Planes<'_> {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        let pixels = self.get(frame).expect("the matcher reads only the views of its parameters");
        line.copy_from_slice(&pixels[v * self.size[0]..][..self.size[0]]);
        Ok(())
    }
}

impl Rewind for &Planes<'_> {
    fn rewind(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
