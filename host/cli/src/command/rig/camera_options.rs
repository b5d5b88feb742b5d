//! The options of cameras that took photos.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    CameraModel, Error, Frames, Result, Rig,
    files::{FrameFiles, exif_focal},
    lens::LensFile,
};
use multiscopic_core::Frame;

use crate::command::{
    limits,
    options::{
        BitsOption, depth_of, read_lens,
        value::{point, positive},
    },
    terminal,
};

/// The largest ratio of focal lengths of photos that were taken without zooming between them.
const SAME_FOCAL: f64 = 1.01;

/// The camera of photos, as far as it is known.
#[derive(Clone, Debug, Args)]
pub struct CameraOptions {
    /// Focal length in pixels; depth needs it [default: that of --lens, or what the EXIF of the photos tells]
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Point where the optical axis meets the image, in pixels from the centre of the top left pixel [default: that of --lens, or
    /// the middle of the image]
    #[arg(long, value_name = "CX,CY", value_parser = point, allow_negative_numbers = true)]
    principal_point: Option<[f64; 2]>,

    /// Calibration of the lens, if it distorts the photos: a camera.toml, or a file of ROS (camera_info), OpenCV or Kalibr. A copy
    /// is kept beside rig.toml
    #[arg(long, value_name = "FILE", conflicts_with_all = ["focal_px", "principal_point"])]
    lens: Option<PathBuf>,

    #[command(flatten)]
    bits: BitsOption,
}

impl CameraOptions {
    /// The calibration of the lens, if one is given.
    pub fn calibration(&self) -> Result<Option<CameraModel>> {
        let lens: Option<LensFile> = self.lens.as_deref().map(read_lens).transpose()?;
        Ok(lens.map(|lens| lens.camera))
    }

    /// Refuses a folder that has a rig.toml, or a camera.toml where a calibration would be kept.
    pub fn check_folder(&self, directory: &Path, is_calibrated: bool) -> Result<()> {
        let names = [Some(Rig::FILE_NAME), is_calibrated.then_some(CameraModel::FILE_NAME)];
        let mut paths = names.into_iter().flatten().map(|name| directory.join(name));
        // A calibration that is in the folder stays where it is.
        match paths.find(|path| path.exists() && self.lens.as_ref() != Some(path)) {
            Some(path) => Err(Error::Usage(format!("{} is there already: change it by hand, or move it away", path.display()))),
            None => Ok(()),
        }
    }

    /// Reads the photos, which finds those of other sizes, writes the rig.toml of `known` and these options, and says which photo is
    /// of which view.
    pub fn write(&self, directory: &Path, known: Rig, calibration: Option<CameraModel>) -> Result<ExitCode> {
        let files = known.images.within(directory);
        let of_sweep: Vec<PathBuf> = known.sweep.iter().map(|frame| directory.join(&frame.image)).collect();
        let paths: Vec<&Path> = files.paths().chain(of_sweep.iter().map(PathBuf::as_path)).collect();
        let images = FrameFiles { bits: depth_of(&self.bits, None, &paths)?, ..known.images.clone() };
        let (frames, _) = Frames::load_each(&images.within(directory), limits(), |_, _| Ok(None))?;
        let is_known = self.focal_px.is_some() || known.focal_px.is_some() || calibration.is_some();
        let by_exif = if is_known { None } else { focal_of_exif(&paths, frames.size())? };
        if let Some(camera) = &calibration {
            camera.check_size(self.lens.as_deref().unwrap_or(Path::new(CameraModel::FILE_NAME)), frames.size())?;
            let path = directory.join(CameraModel::FILE_NAME);
            if self.lens.as_ref() != Some(&path) {
                camera.save(&path)?;
            }
        }
        let rig = Rig {
            focal_px: self.focal_px.or(known.focal_px).or(calibration.map(|camera| camera.focal_px[0])).or(by_exif),
            principal_point: self.principal_point.or(known.principal_point).or(calibration.map(|camera| camera.principal_point)),
            lens: calibration.map(|_| CameraModel::FILE_NAME.into()),
            images,
            ..known
        };
        rig.save(directory)?;
        for frame in [Frame::Center].into_iter().chain(frames.views().iter().map(Frame::View)) {
            let file = rig.images.get(frame).unwrap_or(Path::new(""));
            terminal::say(&format!("{frame}: {}", file.display()));
        }
        if let (Some(first), Some(last)) = (rig.sweep.first(), rig.sweep.last()) {
            terminal::say(&format!("sweep: {} frames from {} to {} mm", rig.sweep.len(), first.offset_mm, last.offset_mm));
        }
        if rig.focal_px.is_none() || rig.baseline_mm.is_none() {
            terminal::say("depth needs the focal length and the baseline: give --focal-px or --lens, and --baseline-mm");
        }
        terminal::say(&format!("wrote {}", directory.join(Rig::FILE_NAME).display()));
        Ok(ExitCode::SUCCESS)
    }
}

/// The focal length in pixels that the EXIF of photos of a size tells, which is said. `None` if it tells none.
fn focal_of_exif(paths: &[&Path], size: [usize; 2]) -> Result<Option<f64>> {
    let mut first: Option<(&Path, f64)> = None;
    for path in paths {
        let Some(found) = exif_focal(path, size, limits())? else { continue };
        let Some((other, focal_px)) = first else {
            let (name, source, px) = (path.display(), &found.source, found.focal_px);
            terminal::say(&format!(
                "focal length by the EXIF of {name}: {px:.0} pixels ({source}), right to some percent, and depth with it; \
                 `multiscopic calibrate lens` measures it"
            ));
            first = Some((path, found.focal_px));
            continue;
        };
        if focal_px.max(found.focal_px) / focal_px.min(found.focal_px) > SAME_FOCAL {
            return Err(Error::Usage(format!(
                "by their EXIF, {} has a focal length of {focal_px:.0} pixels and {} one of {:.0}: take all photos without zooming, or \
                 give --focal-px",
                other.display(),
                path.display(),
                found.focal_px
            )));
        }
    }
    Ok(first.map(|(_, focal_px)| focal_px))
}
