//! The frames of one capture, in memory.

use std::{collections::BTreeMap, convert::Infallible};

use image::{GrayImage, RgbImage, imageops};
use multiscopic_core::{Frame, Rewind, ScanlineSource, View, Views};
use multiscopic_engine::Planes;

use super::picture::Picture;

/// A centre frame and its neighbours, all of the same size, in 8-bit grey. If every frame has colours, they
/// are kept as well, for the methods that use them.
///
/// ```
/// use image::GrayImage;
/// use multiscopic::Frames;
/// use multiscopic_core::{View, Views};
/// let frames = Frames::new(GrayImage::new(64, 48)).with(View::RIGHT, GrayImage::new(64, 48));
/// assert_eq!((frames.size(), frames.views()), ([64, 48], Views::STEREO));
/// ```
#[derive(Clone, Debug)]
pub struct Frames {
    center: GrayImage,
    neighbors: BTreeMap<View, GrayImage>,
    /// Present only if every frame has colours.
    colors: Option<Colors>,
}

/// The colours of a centre frame and its neighbours.
#[derive(Clone, Debug)]
struct Colors {
    center: RgbImage,
    neighbors: BTreeMap<View, RgbImage>,
}

impl Frames {
    /// A grey centre frame without neighbours.
    pub fn new(center: GrayImage) -> Frames {
        Frames { center, neighbors: BTreeMap::new(), colors: None }
    }

    /// Adds or replaces a grey neighbour. This drops the colours of all frames.
    ///
    /// # Panics
    /// If the neighbour and the centre differ in size, or there are more than [`Views::MAX`] neighbours.
    pub fn with(mut self, view: View, image: GrayImage) -> Frames {
        assert_eq!(image.dimensions(), self.center.dimensions(), "the size of the {view} view");
        self.neighbors.insert(view, image);
        assert!(self.neighbors.len() <= Views::MAX, "{} views", self.neighbors.len());
        self.colors = None;
        self
    }

    /// Drops the colours, which take three times the memory of the grey values.
    pub fn without_color(self) -> Frames {
        Frames { colors: None, ..self }
    }

    /// A copy of a frame, in colour if it has colours.
    pub fn picture(&self, frame: Frame) -> Option<Picture> {
        let color = self.color(frame).cloned().map(Picture::Rgb);
        color.or_else(|| self.get(frame).cloned().map(Picture::Gray))
    }

    /// A centre frame without neighbours, with its colours if it has any.
    pub fn of_picture(center: Picture) -> Frames {
        let gray = center.to_gray();
        let colors = match center.into_8_bits() {
            Picture::Rgb(center) => Some(Colors { center, neighbors: BTreeMap::new() }),
            _ => None,
        };
        Frames { colors, ..Frames::new(gray) }
    }

    /// Frames of pictures, with their colours if all have some. `None` if none of them is the centre.
    ///
    /// # Panics
    /// As [`with_picture`](Frames::with_picture).
    pub fn of_pictures(mut pictures: Vec<(Frame, Picture)>) -> Option<Frames> {
        let at = pictures.iter().position(|(frame, _)| *frame == Frame::Center)?;
        let (_, center) = pictures.swap_remove(at);
        let add = |frames: Frames, (frame, picture)| match frame {
            Frame::View(view) => frames.with_picture(view, picture),
            Frame::Center => frames,
        };
        Some(pictures.into_iter().fold(Frames::of_picture(center), add))
    }

    /// Adds or replaces a neighbour. The frames keep their colours only if this neighbour has colours too.
    ///
    /// # Panics
    /// If the neighbour and the centre differ in size.
    pub fn with_picture(mut self, view: View, picture: Picture) -> Frames {
        let colors = self.colors.take();
        let frames = self.with(view, picture.to_gray());
        let colors = match (colors, picture.into_8_bits()) {
            (Some(mut colors), Picture::Rgb(image)) => {
                colors.neighbors.insert(view, image);
                Some(colors)
            }
            _ => None,
        };
        Frames { colors, ..frames }
    }

    /// The frames with `f` applied to each picture. The pictures are in colour if all frames are.
    pub fn map(&self, f: impl Fn(&Picture) -> Picture) -> Frames {
        let picture = |frame: Frame, gray: &GrayImage| match self.color(frame) {
            Some(rgb) => f(&Picture::Rgb(rgb.clone())),
            None => f(&Picture::Gray(gray.clone())),
        };
        let center = Frames::of_picture(picture(Frame::Center, &self.center));
        self.neighbors.iter().fold(center, |frames, (view, gray)| frames.with_picture(*view, picture(Frame::View(*view), gray)))
    }

    /// Crops the centre and the neighbours `views` to the `width` x `height` pixels in their middle, in grey.
    ///
    /// # Panics
    /// If the frames are smaller than that, or a view is missing.
    pub fn middle(&self, [width, height]: [usize; 2], views: Views) -> Frames {
        let [left, top] = [self.width() - width, self.height() - height].map(|rest| rest as u32 / 2);
        let cut = |frame| {
            let image = self.get(frame).unwrap_or_else(|| panic!("no {frame} frame"));
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

    /// The neighbours present.
    pub fn views(&self) -> Views {
        self.neighbors.keys().copied().collect()
    }

    /// The colours of a frame, or `None` if it is missing or some frame is grey.
    pub fn color(&self, frame: Frame) -> Option<&RgbImage> {
        let colors = self.colors.as_ref()?;
        match frame {
            Frame::Center => Some(&colors.center),
            Frame::View(view) => colors.neighbors.get(&view),
        }
    }

    /// The pixels, borrowed, as the engine takes them.
    pub fn planes(&self) -> Planes<'_> {
        let planes = Planes::new(self.size(), self.center.as_raw());
        let planes = self.neighbors.iter().fold(planes, |planes, (view, image)| planes.with(*view, image.as_raw()));
        match &self.colors {
            Some(colors) => planes.with_color(colors.center.as_raw()),
            None => planes,
        }
    }

    /// A frame in grey, or `None` if it is missing.
    pub fn get(&self, frame: Frame) -> Option<&GrayImage> {
        match frame {
            Frame::Center => Some(&self.center),
            Frame::View(view) => self.neighbors.get(&view),
        }
    }
}

/// Each reference is a source of its own, so several passes can read the same frames at once.
impl ScanlineSource for &Frames {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        let image = self.get(frame).expect("the matcher reads only the views of its parameters");
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
    fn the_middle_is_cropped_from_every_view() {
        let image = |first: u8| GrayImage::from_raw(4, 3, (first..first + 12).collect()).unwrap();
        let frames = Frames::new(image(0)).with(View::LEFT, image(50)).with(View::TOP, image(100));
        let middle = frames.middle([2, 2], Views::NONE.with(View::LEFT));
        assert_eq!((middle.size(), middle.views()), ([2, 2], Views::NONE.with(View::LEFT)));
        assert_eq!(middle.get(Frame::Center).unwrap().as_raw(), &[1, 2, 5, 6]);
        assert_eq!(middle.get(Frame::View(View::LEFT)).unwrap().as_raw(), &[51, 52, 55, 56]);
    }
}
