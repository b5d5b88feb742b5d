//! The image files of a capture, one for each frame.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use multiscopic_core::{Frame, View, Views};
use serde::{Deserialize, Serialize};

use super::image_codec::write_png;
use crate::{
    error::{Error, Result},
    files::Limits,
    images::{BitDepth, Frames, Picture},
};

/// The image file of each frame: the `[images]` of a `rig.toml`. Relative paths are relative to its folder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameFiles {
    /// The centre frame, which is the reference.
    pub center: PathBuf,
    /// The frame taken with the camera moved to the left.
    pub left: Option<PathBuf>,
    /// The frame taken with the camera moved to the right.
    pub right: Option<PathBuf>,
    /// The frame taken with the camera moved up.
    pub top: Option<PathBuf>,
    /// The frame taken with the camera moved down.
    pub bottom: Option<PathBuf>,
    /// The bits of 16-bit images, if known: else the least number that has their brightest sample.
    pub bits: Option<BitDepth>,
    /// The frames taken elsewhere, by their offsets in baselines to the right and down, such as `1,-1`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty", with = "by_offset")]
    pub views: BTreeMap<View, PathBuf>,
}

/// Views as keys of a table: `[images.views]`.
mod by_offset {
    use std::{collections::BTreeMap, path::PathBuf};

    use multiscopic_core::View;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(views: &BTreeMap<View, PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(views.iter().map(|(view, path)| (view.to_string(), path)))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<View, PathBuf>, D::Error> {
        let named = BTreeMap::<String, PathBuf>::deserialize(deserializer)?.into_iter();
        let views = named.map(|(name, path)| {
            let view: View = name.parse().map_err(|error| D::Error::custom(format!("{name}: {error}")))?;
            match view.name() {
                Some(key) => Err(D::Error::custom(format!("the view {name} has a key of its own, {key}"))),
                None => Ok((view, path)),
            }
        });
        views.collect()
    }
}

impl FrameFiles {
    /// The name of the file that a capture writes a frame to: `center.png`, `left.png` and so on.
    pub fn name_of(frame: Frame) -> String {
        format!("{frame}.png")
    }

    /// The files that a capture of the centre and `views` writes.
    pub fn of_capture(views: Views) -> FrameFiles {
        let file = |frame| PathBuf::from(FrameFiles::name_of(frame));
        let center = FrameFiles { center: file(Frame::Center), ..FrameFiles::default() };
        views.iter().fold(center, |files, view| files.with(view, file(Frame::View(view))))
    }

    /// Adds or replaces the file of a view.
    pub fn with(mut self, view: View, path: PathBuf) -> FrameFiles {
        match view {
            View::LEFT => self.left = Some(path),
            View::RIGHT => self.right = Some(path),
            View::TOP => self.top = Some(path),
            View::BOTTOM => self.bottom = Some(path),
            _ => _ = self.views.insert(view, path),
        }
        self
    }

    /// The file of a frame, if it has one.
    pub fn get(&self, frame: Frame) -> Option<&Path> {
        match frame {
            Frame::Center => Some(&self.center),
            Frame::View(View::LEFT) => self.left.as_deref(),
            Frame::View(View::RIGHT) => self.right.as_deref(),
            Frame::View(View::TOP) => self.top.as_deref(),
            Frame::View(View::BOTTOM) => self.bottom.as_deref(),
            Frame::View(view) => self.views.get(&view).map(PathBuf::as_path),
        }
    }

    /// The neighbours that have a file.
    pub fn views(&self) -> Views {
        let nearest = View::CROSS.into_iter().filter(|&view| self.get(Frame::View(view)).is_some());
        nearest.chain(self.views.keys().copied()).collect()
    }

    /// All files, beginning with the centre's.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        std::iter::once(Frame::Center).chain(self.views().iter().map(Frame::View)).filter_map(|frame| self.get(frame))
    }

    /// The depth of the 16-bit images, as given or else as their brightest sample tells. `None` if there are none.
    ///
    /// # Errors
    /// Those of [`Picture::brightest`].
    pub fn depth(&self, limits: Limits) -> Result<Option<BitDepth>> {
        match self.bits {
            Some(bits) => Ok(Some(bits)),
            None => Ok(Picture::brightest(&self.paths().collect::<Vec<_>>(), limits)?.map(BitDepth::of_brightest)),
        }
    }

    /// The files with relative paths resolved against `directory`.
    pub fn within(&self, directory: &Path) -> FrameFiles {
        let join = |file: &Option<PathBuf>| file.as_ref().map(|file| directory.join(file));
        FrameFiles {
            center: directory.join(&self.center),
            left: join(&self.left),
            right: join(&self.right),
            top: join(&self.top),
            bottom: join(&self.bottom),
            bits: self.bits,
            views: self.views.iter().map(|(view, file)| (*view, directory.join(file))).collect(),
        }
    }
}

impl Frames {
    /// Reads the frames of a capture. The centre is also returned as the picture in its file, with its
    /// colours. 16-bit images all have the same depth: that of `files`, or of their brightest sample.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a file is not a picture, a sample is above the maximum of the depth, or a
    /// neighbour and the centre differ in size, after they were turned as their EXIF orientations say.
    pub fn load(files: &FrameFiles) -> Result<(Frames, Picture)> {
        Frames::load_each(files, Limits::DEFAULT, |_, _| Ok(None))
    }

    /// Reads the frames of a capture, as [`load`](Frames::load) does, of a size within `limits`. `f` may replace each picture
    /// by another one, all by those of one size, before 8 bits are taken of 16; the centre's comes first. The centre is returned as it is in
    /// its file.
    ///
    /// # Errors
    /// Those of [`load`](Frames::load) and of `f`.
    pub fn load_each(
        files: &FrameFiles,
        limits: Limits,
        mut f: impl FnMut(Frame, &Picture) -> Result<Option<Picture>>,
    ) -> Result<(Frames, Picture)> {
        let depth = files.depth(limits)?;
        let center = Picture::read_within(&files.center, depth, limits)?;
        let mut frames = Frames::of_picture(f(Frame::Center, &center)?.unwrap_or_else(|| center.clone()));
        for view in files.views().iter() {
            let Some(path) = files.get(Frame::View(view)) else { continue };
            let image = Picture::read_within(path, depth, limits)?;
            if image.dimensions() != center.dimensions() {
                let ((width, height), (w, h)) = (center.dimensions(), image.dimensions());
                return Err(Error::format(
                    path,
                    format!("{w}x{h} pixels"),
                    format!("{width}x{height} as in {}: use frames of one capture", files.center.display()),
                ));
            }
            frames = frames.with_picture(view, f(Frame::View(view), &image)?.unwrap_or(image));
        }
        Ok((frames, center))
    }

    /// Writes the frames to `files` as PNG images, in colour if they have colours. A frame without a file is left out.
    ///
    /// # Errors
    /// [`Error::Write`]. Any previous version of a file is unchanged.
    pub fn save(&self, files: &FrameFiles) -> Result<()> {
        let frames = [Frame::Center].into_iter().chain(self.views().iter().map(Frame::View));
        frames.filter_map(|frame| Some((frame, files.get(frame)?, self.get(frame)?))).try_for_each(|(frame, path, gray)| {
            match self.color(frame) {
                Some(color) => write_png(path, color),
                None => write_png(path, gray),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_elsewhere_have_a_table_of_their_own() {
        let text = "center = \"c.png\"\nleft = \"l.png\"\n\n[views]\n\"1,-1\" = \"r.png\"\n";
        let files: FrameFiles = toml::from_str(text).unwrap();
        let corner = View::new(1, -1).unwrap();
        assert_eq!(files.views(), Views::NONE.with(View::LEFT).with(corner));
        assert_eq!(files.get(Frame::View(corner)), Some(Path::new("r.png")));
        assert_eq!(toml::to_string(&files).unwrap(), text);
        let error = |view: &str| toml::from_str::<FrameFiles>(&text.replace("1,-1", view)).unwrap_err().to_string();
        assert!(error("0,0").contains("the offset 0,0 is the centre's"), "{}", error("0,0"));
        assert!(error("-1,0").contains("has a key of its own, left"), "{}", error("-1,0"));
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
        let mut files = FrameFiles { center, top: Some(top), ..FrameFiles::default() };
        let (frames, color) = Frames::load(&files).unwrap();
        assert_eq!((frames.size(), frames.views()), ([2, 1], Views::NONE.with(View::TOP)));
        assert_eq!(frames.get(Frame::Center).unwrap().as_raw(), &[77, 0]);
        assert_eq!(frames.get(Frame::View(View::TOP)).unwrap().as_raw(), &[5, 6]);
        assert_eq!(color.color(0, 0), [255, 0, 0]);
        assert_eq!(frames.color(Frame::Center), None, "one of them is grey");

        let saved = FrameFiles::of_capture(frames.views()).within(dir.path());
        frames.save(&saved).unwrap();
        assert_eq!(Frames::load(&saved).unwrap().0.get(Frame::View(View::TOP)), frames.get(Frame::View(View::TOP)));

        let mut colored = FrameFiles { top: Some(file("top.ppm", b"P6 2 1 255 \0\xFF\0\0\0\xFF")), ..files.clone() };
        let (frames, _) = Frames::load(&colored).unwrap();
        let top = frames.color(Frame::View(View::TOP)).unwrap();
        assert_eq!(
            (frames.get(Frame::View(View::TOP)).unwrap().as_raw(), top.as_raw()),
            (&vec![149, 29], &vec![0, 255, 0, 0, 0, 255])
        );
        assert_eq!(frames.color(Frame::Center).unwrap().as_raw(), &[255, 0, 0, 0, 0, 0]);
        frames.save(&saved).unwrap();
        assert_eq!(Frames::load(&saved).unwrap().0.color(Frame::View(View::TOP)), Some(top));
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
