//! The frames that a command reads.

use std::{
    path::{Path, PathBuf},
    str::FromStr,
};

use clap::Args;
use multiscopic::{
    Alignment, Error, Frames, Picture, Rig,
    files::FrameFiles,
    images::BitDepth,
    lens::{LensFile, Undistortion},
};
use multiscopic_core::{Frame, ParseViewError, View, Views};

use super::BitsOption;
use crate::command::{limits::limits, terminal};

/// The frames: a captured folder, or an image for each.
#[derive(Clone, Debug, Args)]
pub struct SourceOptions {
    /// Captured folder with a rig.toml
    #[arg(value_name = "RIG_DIR", conflicts_with_all = ["center", "left", "right", "top", "bottom", "view"])]
    rig: Option<PathBuf>,

    /// Centre image, the reference
    #[arg(long, value_name = "IMAGE")]
    center: Option<PathBuf>,

    /// Image taken with the camera moved to the left
    #[arg(long, value_name = "IMAGE")]
    left: Option<PathBuf>,

    /// Image taken with the camera moved to the right
    #[arg(long, value_name = "IMAGE")]
    right: Option<PathBuf>,

    /// Image taken with the camera moved up
    #[arg(long, value_name = "IMAGE")]
    top: Option<PathBuf>,

    /// Image taken with the camera moved down
    #[arg(long, value_name = "IMAGE")]
    bottom: Option<PathBuf>,

    /// Image taken with the camera moved by I baselines to the right and J down, such as 1,-1=IMAGE; repeat it for more
    #[arg(long, value_name = "I,J=IMAGE", value_parser = ViewImage::from_str, allow_hyphen_values = true)]
    view: Vec<ViewImage>,

    /// Calibration of the lens, which distorts all images: a camera.toml, or the YAML of ROS, OpenCV or Kalibr [default: the lens
    /// of rig.toml; without one, the images are taken as they are]
    #[arg(long, value_name = "FILE")]
    lens: Option<PathBuf>,

    #[command(flatten)]
    bits: BitsOption,
}

/// The files of the frames and of what belongs to them.
#[derive(Clone, Debug)]
pub struct Source {
    /// The images.
    pub images: FrameFiles,
    /// The rig of a captured folder.
    pub rig: Option<Rig>,
    /// The calibration of the camera, if the images are distorted or the camera is not square to its stage.
    pub lens: Option<LensFile>,
    rig_file: Option<PathBuf>,
    bits: BitsOption,
}

impl Source {
    /// The files of a captured folder, and of a lens other than the rig's if there is one.
    pub fn of_rig(directory: &Path, lens: Option<&Path>, bits: &BitsOption) -> multiscopic::Result<Source> {
        // Whoever names the file means its folder.
        let is_file = directory.file_name().is_some_and(|name| name == Rig::FILE_NAME) && directory.is_file();
        let directory = if is_file { directory.parent().unwrap_or(directory) } else { directory };
        if directory.is_dir() && !directory.join(Rig::FILE_NAME).exists() {
            return Err(Error::Format {
                path: directory.into(),
                found: format!("a folder without {}", Rig::FILE_NAME),
                expected: format!(
                    "a captured folder, whose {} names the images of its views: for photos that are there already, `multiscopic rig init` \
                     writes one",
                    Rig::FILE_NAME
                ),
            });
        }
        let rig = Rig::load(directory)?;
        let lens = LensFile::of_rig(&rig, directory, lens)?;
        let path = directory.join(Rig::FILE_NAME);
        Ok(Source { images: rig.images.within(directory), rig: Some(rig), lens, rig_file: Some(path), bits: bits.clone() })
    }

    /// Reads the frames, without distortion, and the centre as the picture in its file, with its colours and its distortion. The
    /// last is what undistorted them. From then on, the bits of 16-bit images are known.
    pub fn load(&mut self) -> multiscopic::Result<(Frames, Picture, Option<Undistortion>)> {
        self.images.bits = depth_of(&self.bits, self.images.bits, &self.images.paths().collect::<Vec<_>>())?;
        let mut undistortion = None;
        let (frames, center) = Frames::load_each(&self.images, limits(), |picture| {
            let (width, height) = picture.dimensions();
            if let (None, Some(lens)) = (&undistortion, &self.lens) {
                undistortion = Some(lens.undistortion([width as usize, height as usize])?);
            }
            Ok(undistortion.as_ref().map(|undistortion| undistortion.picture(picture)))
        })?;
        Ok((frames, center, undistortion))
    }

    /// The pictures of the frames, read again in all their bits, without distortion and rectified.
    pub fn rectified<'a>(
        &'a self,
        undistortion: Option<&'a Undistortion>,
        alignment: &'a Alignment,
    ) -> impl Iterator<Item = multiscopic::Result<(Frame, Picture)>> + 'a {
        let frames = [Frame::Center].into_iter().chain(self.images.views().iter().map(Frame::View));
        frames.filter_map(|frame| Some((frame, self.images.get(frame)?))).map(move |(frame, path)| {
            let picture = Picture::read_within(path, self.images.bits, limits())?;
            Ok((frame, alignment.rectified(frame, picture, undistortion)))
        })
    }

    /// The frames of [`rectified`](Source::rectified).
    pub fn rectified_frames(&self, undistortion: Option<&Undistortion>, alignment: &Alignment) -> multiscopic::Result<Frames> {
        let rectified = self.rectified(undistortion, alignment).collect::<multiscopic::Result<Vec<_>>>()?;
        Ok(Frames::of_pictures(rectified).expect("the centre is among them"))
    }

    /// The captured folder, if it is one.
    pub fn folder(&self) -> Option<&Path> {
        self.rig_file.as_deref().and_then(Path::parent)
    }

    /// All files that are read.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        let lens = self.lens.as_ref().map(|lens| lens.path.as_path());
        self.images.paths().chain(self.rig_file.as_deref()).chain(lens)
    }
}

/// Returns the depth of the 16-bit images among files of one capture, in this order: that of the command line, the `known` one, or
/// else a guess, which is said if it is below 16 bits. `None` if there are no 16-bit images.
pub fn depth_of(bits: &BitsOption, known: Option<BitDepth>, paths: &[&Path]) -> multiscopic::Result<Option<BitDepth>> {
    if let Some(depth) = bits.bits.or(known) {
        return Ok(Some(depth));
    }
    let Some(brightest) = Picture::brightest(paths, limits())? else { return Ok(None) };
    let depth = BitDepth::of_brightest(brightest);
    if depth != BitDepth::Sixteen {
        let (bits, white) = (depth.bits(), depth.white());
        terminal::say(&format!(
            "16-bit files with {bits}-bit values: the brightest is {brightest}, and {white} is taken for white; --bits says otherwise"
        ));
    }
    Ok(Some(depth))
}

/// A view and its image, as `--view` takes them.
#[derive(Clone, Debug)]
struct ViewImage {
    view: View,
    path: PathBuf,
}

impl FromStr for ViewImage {
    type Err = String;

    fn from_str(text: &str) -> Result<ViewImage, String> {
        let (view, path) = text.split_once('=').ok_or("it has no = between the view and its image, as in 1,-1=IMAGE")?;
        Ok(ViewImage { view: view.parse().map_err(|error: ParseViewError| error.to_string())?, path: path.into() })
    }
}

impl SourceOptions {
    /// The captured folder at a path, with these options.
    pub fn source_of(&self, directory: &Path) -> multiscopic::Result<Source> {
        Source::of_rig(directory, self.lens.as_deref(), &self.bits)
    }

    /// Returns the files that the command line names. `None` if it names no images.
    pub fn source(&self) -> multiscopic::Result<Option<Source>> {
        if let Some(directory) = &self.rig {
            return self.source_of(directory).map(Some);
        }
        let SourceOptions { center, left, right, top, bottom, view, rig: _, lens, bits } = self.clone();
        let images = FrameFiles { center: center.clone().unwrap_or_default(), left, right, top, bottom, ..FrameFiles::default() };
        let images = view.into_iter().try_fold(images, |images, ViewImage { view, path }| {
            if images.get(Frame::View(view)).is_some() {
                return Err(Error::Usage(format!("there are two images of the {view} view: give one")));
            }
            if images.views().len() == Views::MAX {
                return Err(Error::Usage(format!("there are more than {} views", Views::MAX)));
            }
            Ok(images.with(view, path))
        })?;
        match (center, images.views().is_empty()) {
            (None, true) => Ok(None),
            (None, false) => {
                let message = "the neighbours have no centre to match: give --center, or RIG_DIR, a folder with a rig.toml";
                Err(Error::Usage(message.into()))
            }
            (Some(_), true) => {
                let message = "there is no neighbour to match: give at least one of --left, --right, --top, --bottom and --view";
                Err(Error::Usage(message.into()))
            }
            (Some(_), false) => {
                let lens = lens.map(|path| LensFile::read(&path)).transpose()?;
                Ok(Some(Source { images, rig: None, lens, rig_file: None, bits }))
            }
        }
    }
}
