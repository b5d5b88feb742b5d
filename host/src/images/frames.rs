//! The frames of one capture, in memory.

use std::convert::Infallible;

use image::{GrayImage, RgbImage, imageops};
use multiscopic_core::{Frame, Rewind, ScanlineSource, View, Views};

use super::Picture;

/// A centre frame and its neighbours, all of one size, in 8-bit grey; and their colours, for the methods that match them too.
#[derive(Clone, Debug)]
pub struct Frames {
    center: GrayImage,
    neighbors: [Option<GrayImage>; 4],
    /// Of the centre and the neighbours, or of none.
    colors: Option<Colors>,
}

/// The colours of a centre frame and its neighbours.
#[derive(Clone, Debug)]
struct Colors {
    center: RgbImage,
    neighbors: [Option<RgbImage>; 4],
}

impl Frames {
    /// The centre alone.
    pub fn new(center: GrayImage) -> Frames {
        Frames { center, neighbors: [const { None }; 4], colors: None }
    }

    /// These frames and a neighbour, which is grey: so are all others then.
    ///
    /// # Panics
    /// If the neighbour's size is not that of the centre.
    pub fn with(mut self, view: View, image: GrayImage) -> Frames {
        assert_eq!(image.dimensions(), self.center.dimensions(), "the size of the {view:?} view");
        self.neighbors[view as usize] = Some(image);
        self.colors = None;
        self
    }

    /// The centre alone, with its colours if it has some.
    pub fn of_picture(center: Picture) -> Frames {
        let gray = center.to_gray();
        let colors = match center {
            Picture::Gray(_) => None,
            Picture::Rgb(center) => Some(Colors { center, neighbors: [const { None }; 4] }),
        };
        Frames { colors, ..Frames::new(gray) }
    }

    /// These frames and a neighbour; the colours stay if it has some.
    ///
    /// # Panics
    /// If the neighbour's size is not that of the centre.
    pub fn with_picture(mut self, view: View, picture: Picture) -> Frames {
        let colors = self.colors.take();
        let frames = self.with(view, picture.to_gray());
        let colors = match (colors, picture) {
            (Some(mut colors), Picture::Rgb(image)) => {
                colors.neighbors[view as usize] = Some(image);
                Some(colors)
            }
            _ => None,
        };
        Frames { colors, ..frames }
    }

    /// The `width` x `height` pixels in the middle of the centre and of its neighbours `views`.
    ///
    /// # Panics
    /// If the frames are smaller, or a view is not there.
    pub fn middle(&self, [width, height]: [usize; 2], views: Views) -> Frames {
        let [left, top] = [self.width() - width, self.height() - height].map(|rest| rest as u32 / 2);
        let cut = |frame| {
            let image = self.get(frame).unwrap_or_else(|| panic!("there is no frame {frame:?}"));
            imageops::crop_imm(image, left, top, width as u32, height as u32).to_image()
        };
        views.iter().fold(Frames::new(cut(Frame::Center)), |frames, view| frames.with(view, cut(Frame::View(view))))
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.center.width() as usize
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.center.height() as usize
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width(), self.height()]
    }

    /// The neighbours that there are.
    pub fn views(&self) -> Views {
        View::ALL.into_iter().filter(|&view| self.neighbors[view as usize].is_some()).collect()
    }

    /// The colours of an image, if it is there and all images have colours.
    pub fn color(&self, frame: Frame) -> Option<&RgbImage> {
        let colors = self.colors.as_ref()?;
        match frame {
            Frame::Center => Some(&colors.center),
            Frame::View(view) => colors.neighbors[view as usize].as_ref(),
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle() {
        let image = |first: u8| GrayImage::from_raw(4, 3, (first..first + 12).collect()).unwrap();
        let frames = Frames::new(image(0)).with(View::Left, image(50)).with(View::Top, image(100));
        let middle = frames.middle([2, 2], Views::NONE.with(View::Left));
        assert_eq!((middle.size(), middle.views()), ([2, 2], Views::NONE.with(View::Left)));
        assert_eq!(middle.get(Frame::Center).unwrap().as_raw(), &[1, 2, 5, 6]);
        assert_eq!(middle.get(Frame::View(View::Left)).unwrap().as_raw(), &[51, 52, 55, 56]);
    }
}
