//! The image files of a capture, a file for each frame.

use std::path::{Path, PathBuf};

use multiscopic_core::{Frame, View, Views};
use serde::{Deserialize, Serialize};

use super::codec::write_png;
use crate::{
    error::Error,
    images::{Frames, Picture},
};

/// The image file of every view, relative to the folder of `rig.toml` or absolute.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Images {
    /// The reference.
    pub center: PathBuf,
    /// With the camera moved to the left.
    pub left: Option<PathBuf>,
    /// With the camera moved to the right.
    pub right: Option<PathBuf>,
    /// With the camera moved up.
    pub top: Option<PathBuf>,
    /// With the camera moved down.
    pub bottom: Option<PathBuf>,
}

impl Images {
    /// The name of the file that a capture writes a frame to: `center.png`, `left.png` and so on.
    pub fn file_of(frame: Frame) -> String {
        format!("{}.png", frame.name())
    }

    /// The names of the files that a capture of the centre and of `views` writes.
    pub fn of_capture(views: Views) -> Images {
        let file = |frame| PathBuf::from(Images::file_of(frame));
        let neighbor = |view| views.contains(view).then(|| file(Frame::View(view)));
        Images {
            center: file(Frame::Center),
            left: neighbor(View::Left),
            right: neighbor(View::Right),
            top: neighbor(View::Top),
            bottom: neighbor(View::Bottom),
        }
    }

    /// The file of a frame, as the rig names it.
    pub fn get(&self, frame: Frame) -> Option<&Path> {
        match frame {
            Frame::Center => Some(&self.center),
            Frame::View(View::Left) => self.left.as_deref(),
            Frame::View(View::Right) => self.right.as_deref(),
            Frame::View(View::Top) => self.top.as_deref(),
            Frame::View(View::Bottom) => self.bottom.as_deref(),
        }
    }

    /// The neighbours that have a file.
    pub fn views(&self) -> Views {
        View::ALL.into_iter().filter(|&view| self.get(Frame::View(view)).is_some()).collect()
    }

    /// All files, the centre's first.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        std::iter::once(Frame::Center).chain(View::ALL.map(Frame::View)).filter_map(|frame| self.get(frame))
    }

    /// The same files if `directory` is what they are relative to.
    pub fn within(&self, directory: &Path) -> Images {
        let join = |file: &Option<PathBuf>| file.as_ref().map(|file| directory.join(file));
        Images {
            center: directory.join(&self.center),
            left: join(&self.left),
            right: join(&self.right),
            top: join(&self.top),
            bottom: join(&self.bottom),
        }
    }
}

impl Frames {
    /// Reads the files of a capture, and gives the centre in its colours too.
    ///
    /// # Errors
    /// If a file cannot be read or is no picture, or if a neighbour has another size than the centre.
    pub fn load(files: &Images) -> crate::error::Result<(Frames, Picture)> {
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
    pub fn save(&self, files: &Images) -> crate::error::Result<()> {
        let frames = [Frame::Center].into_iter().chain(self.views().iter().map(Frame::View));
        frames
            .filter_map(|frame| Some((files.get(frame)?, self.get(frame)?)))
            .try_for_each(|(path, image)| write_png(path, image))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
