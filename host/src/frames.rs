//! The frames of one capture, in memory.

use std::convert::Infallible;

use image::{GrayImage, RgbImage, imageops};
use multiscopic_core::{Frame, Rewind, ScanlineSource, View, Views};

use crate::{Error, Picture, image_file::write_png, rig::Images};

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

    /// Reads the files of a capture, and gives the centre in its colours too.
    ///
    /// # Errors
    /// If a file cannot be read or is no picture, or if a neighbour has another size than the centre.
    pub fn load(files: &Images) -> crate::Result<(Frames, Picture)> {
        let center = Picture::read(&files.center)?;
        let mut frames = Frames::of_picture(center.clone());
        for view in files.views().iter() {
            let Some(path) = files.get(Frame::View(view)) else { continue };
            let image = Picture::read(path)?;
            if image.dimensions() != center.dimensions() {
                let ((width, height), (w, h)) = (center.dimensions(), image.dimensions());
                return Err(Error::format(
                    path,
                    format!("{w}x{h} pixels"),
                    format!("{width}x{height} as in {}: use frames of one capture", files.center.display()),
                ));
            }
            frames = frames.with_picture(view, image);
        }
        Ok((frames, center))
    }

    /// Writes the frames to the `files` as PNG images.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn save(&self, files: &Images) -> crate::Result<()> {
        let frames = [Frame::Center].into_iter().chain(self.views().iter().map(Frame::View));
        frames
            .filter_map(|frame| Some((files.get(frame)?, self.get(frame)?)))
            .try_for_each(|(path, image)| write_png(path, image))
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

    #[test]
    fn loads_the_files_of_a_capture() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = dir.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let center = file("center.ppm", b"P6 2 1 255 \xFF\0\0\0\0\0");
        let top = file("top.pgm", b"P5 2 1 255 \x05\x06");
        let mut files = Images { center, top: Some(top), ..Images::default() };
        let (frames, color) = Frames::load(&files).unwrap();
        assert_eq!((frames.size(), frames.views()), ([2, 1], Views::NONE.with(View::Top)));
        assert_eq!(frames.get(Frame::Center).unwrap().as_raw(), &[77, 0]);
        assert_eq!(frames.get(Frame::View(View::Top)).unwrap().as_raw(), &[5, 6]);
        assert_eq!(color.color(0, 0), [255, 0, 0]);
        assert_eq!(frames.color(Frame::Center), None, "one of them is grey");

        let saved = Images::of_capture(frames.views()).within(dir.path());
        frames.save(&saved).unwrap();
        assert_eq!(Frames::load(&saved).unwrap().0.get(Frame::View(View::Top)), frames.get(Frame::View(View::Top)));

        let mut colored = Images { top: Some(file("top.ppm", b"P6 2 1 255 \0\xFF\0\0\0\xFF")), ..files.clone() };
        let (frames, _) = Frames::load(&colored).unwrap();
        let top = frames.color(Frame::View(View::Top)).unwrap();
        assert_eq!(
            (frames.get(Frame::View(View::Top)).unwrap().as_raw(), top.as_raw()),
            (&vec![149, 29], &vec![0, 255, 0, 0, 0, 255])
        );
        assert_eq!(frames.color(Frame::Center).unwrap().as_raw(), &[255, 0, 0, 0, 0, 0]);
        colored.left = files.top.clone();
        assert!(Frames::load(&colored).unwrap().0.color(Frame::Center).is_none(), "the left is grey");

        files.left = Some(file("left.pgm", b"P5 1 2 255 \0\0"));
        let message = Frames::load(&files).unwrap_err().to_string();
        for part in ["left.pgm: found 1x2 pixels, expected 2x1 as in", "center.ppm"] {
            assert!(message.contains(part), "{message}");
        }
        files.left = Some(dir.path().join("none.pgm"));
        assert!(Frames::load(&files).unwrap_err().to_string().contains("none.pgm"));
    }
}
