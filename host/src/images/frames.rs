//! The frames of one capture, in memory, and the places where they are taken.

use std::{collections::BTreeMap, convert::Infallible, fmt, str::FromStr};

use image::{GrayImage, RgbImage, imageops};
use multiscopic_core::{Frame, Rewind, ScanlineSource, View, Views};
use multiscopic_engine::Planes;

use super::picture::Picture;
use crate::error::Error;

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

/// The places of the camera around the centre: on a cross, or on an array of rows and columns, one baseline apart.
///
/// It is written `cross`, or as rows and columns, such as `3x3`. Both are odd, so that the centre is in the middle.
///
/// ```
/// use multiscopic::images::Layout;
/// use multiscopic_core::Views;
/// let views = |text: &str| text.parse::<Layout>().unwrap().views();
/// assert_eq!([views("cross"), views("3x3"), views("1x3")], [Views::CROSS, Views::ARRAY, Views::HORIZONTAL]);
/// assert_eq!(views("5x5").len(), 24);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout(Shape);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Cross,
    Array { rows: u8, columns: u8 },
}

impl Layout {
    /// The four nearest neighbours.
    pub const CROSS: Layout = Layout(Shape::Cross);

    /// An array of `rows` x `columns`, with the centre in the middle.
    ///
    /// # Errors
    /// [`Error::Usage`] if a number is even, or they leave no neighbour or more than [`Views::MAX`].
    pub fn array(rows: u8, columns: u8) -> Result<Layout, Error> {
        let cameras = usize::from(rows) * usize::from(columns);
        let problem = if rows.is_multiple_of(2) || columns.is_multiple_of(2) {
            "rows and columns must be odd, so that the centre is in the middle".to_owned()
        } else if cameras == 1 {
            "it has no neighbours".to_owned()
        } else if cameras > Views::MAX + 1 {
            format!("{} neighbours are more than {}", cameras - 1, Views::MAX)
        } else {
            return Ok(Layout(Shape::Array { rows, columns }));
        };
        Err(Error::Usage(format!("the layout {rows}x{columns}: {problem}")))
    }

    /// The neighbours.
    pub fn views(self) -> Views {
        match self.0 {
            Shape::Cross => Views::CROSS,
            Shape::Array { rows, columns } => {
                let around_center = |count: u8| -(count as i8 / 2)..=count as i8 / 2;
                // The centre is not a view.
                let offsets = around_center(rows).flat_map(|down| around_center(columns).map(move |right| (right, down)));
                offsets.filter_map(|(right, down)| View::new(right, down).ok()).collect()
            }
        }
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Shape::Cross => f.pad("cross"),
            Shape::Array { rows, columns } => f.pad(&format!("{rows}x{columns}")),
        }
    }
}

impl FromStr for Layout {
    type Err = Error;

    fn from_str(text: &str) -> Result<Layout, Error> {
        if text == "cross" {
            return Ok(Layout::CROSS);
        }
        let sides = text.split_once('x').and_then(|(rows, columns)| Some((rows.parse().ok()?, columns.parse().ok()?)));
        let unknown = || Error::Usage(format!("the layout {text} is not cross, or rows and columns such as 3x3"));
        sides.ok_or_else(unknown).and_then(|(rows, columns)| Layout::array(rows, columns))
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

    #[test]
    fn a_name_parses_to_its_layout() {
        for name in ["cross", "3x3", "1x3", "3x1", "5x5", "1x9", "1x25", "25x1", "3x7"] {
            assert_eq!(name.parse::<Layout>().unwrap().to_string(), name);
        }
    }

    #[test]
    fn an_array_is_around_its_centre() {
        let offsets = |text: &str| -> Vec<(i8, i8)> {
            let views = text.parse::<Layout>().unwrap().views();
            let mut offsets: Vec<_> = views.iter().map(|view| (view.down(), view.right())).collect();
            offsets.sort_unstable();
            offsets
        };
        assert_eq!(offsets("1x5"), [(0, -2), (0, -1), (0, 1), (0, 2)]);
        assert_eq!(offsets("3x1"), [(-1, 0), (1, 0)]);
        let five_by_three = offsets("5x3");
        assert_eq!(five_by_three.len(), 14);
        assert_eq!((five_by_three[0], five_by_three[13]), ((-2, -1), (2, 1)));
    }

    #[test]
    fn what_is_no_layout_is_refused() {
        let refused = |text: &str, expected: &str| {
            let message = text.parse::<Layout>().unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        };
        for text in ["", "x", "3", "star", "3x", "3x3x3", "-3x3", "300x1", "3 x 3"] {
            refused(text, "not cross");
        }
        for text in ["2x3", "3x4", "0x3", "0x0"] {
            refused(text, "must be odd");
        }
        refused("1x1", "no neighbours");
        refused("1x27", "26 neighbours are more than 24");
        refused("5x7", "34 neighbours are more than 24");
    }
}
