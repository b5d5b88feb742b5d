//! `multiscopic scene`: made-up captures with known disparities.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{Args, ValueEnum, value_parser};
use multiscopic::{
    Error, Result, Rig,
    files::{FrameFiles, Provenance, image_codec::write_png, output},
    scene::{ObjectKind, PinholeCamera, RandomScene, Setting, Shot},
};
use multiscopic_core::{Frame, Views};
use rayon::prelude::*;

use super::{
    options::{NeighborOptions, value},
    terminal,
};

/// Renders captures of made-up scenes with known disparities, to test, fit or train with
///
/// DIR gets a folder 0000, 0001, ... for each scene: the views, rig.toml, and truth.pfm with the true disparities of the centre,
/// as `match` and `evaluate` read them. Scenes differ in their objects, textures, reflections and light, in the noise and blur of
/// the camera, and in how exactly it was moved. Disparities fill a part of about 1 to 30 pixels in views that are 256 pixels
/// wide, and of more in wider ones.
#[derive(Clone, Debug, Args)]
pub struct SceneCommand {
    /// Makes random scenes, the only kind there is
    #[arg(long, required = true)]
    random: bool,

    /// Seed of all scenes. Scene 7 of a seed is always the same, on every machine and whatever the count
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Number of scenes
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = value_parser!(u32).range(1..=1_000_000))]
    count: u32,

    /// Setting in which the scenes are captured
    #[arg(long, value_name = "SETTING", value_enum, default_value_t)]
    setting: SettingName,

    /// Kinds of the objects before the walls, by turns, to see what a method makes of them [default: objects of any kind]
    #[arg(long, value_name = "KIND,...", value_enum, value_delimiter = ',')]
    objects: Vec<ObjectName>,

    /// Size of the views in pixels, from 16x16 to 4096x4096
    #[arg(long, value_name = "WxH", default_value = "256x192", value_parser = view_size)]
    size: [u32; 2],

    #[command(flatten)]
    neighbors: NeighborOptions,

    /// Folder for the captures, which must not exist or be empty
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// The settings by their names.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum SettingName {
    /// Anything, by a small and noisy camera on a cheap stage
    #[default]
    Field,
    /// Before walls that are often plain, by a good camera on an exact stage
    Studio,
}

impl From<SettingName> for Setting {
    fn from(name: SettingName) -> Setting {
        match name {
            SettingName::Field => Setting::Field,
            SettingName::Studio => Setting::Studio,
        }
    }
}

/// The kinds of objects by their names.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ObjectName {
    /// Polished, with reflections that each view sees elsewhere
    Shiny,
    /// Of a single colour
    Blank,
    /// Rods of 0.8 to 4.4 pixels in views that are 256 pixels wide
    Thin,
    /// Boards whose pattern repeats exactly along rows and columns
    Repeating,
    /// Bars with deep slits between them, which only views along the slits see into
    Slits,
}

impl From<ObjectName> for ObjectKind {
    fn from(name: ObjectName) -> ObjectKind {
        match name {
            ObjectName::Shiny => ObjectKind::Shiny,
            ObjectName::Blank => ObjectKind::Blank,
            ObjectName::Thin => ObjectKind::Thin,
            ObjectName::Repeating => ObjectKind::Repeating,
            ObjectName::Slits => ObjectKind::Slits,
        }
    }
}

impl SceneCommand {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let views = self.neighbors.views()?;
        output::check_folder(&self.output)?;
        fs::create_dir_all(&self.output).map_err(|source| Error::Write { path: self.output.clone(), source })?;
        let bar = terminal::progress(self.count.into(), "scenes");
        (0..self.count).into_par_iter().try_for_each(|number| {
            let folder = self.output.join(format!("{number:04}"));
            self.write(&folder, number, views).inspect(|()| bar.inc(1))
        })?;
        bar.finish_and_clear();
        Ok(ExitCode::SUCCESS)
    }

    /// Renders a scene and writes it to a folder, which appears once it is complete.
    fn write(&self, folder: &Path, number: u32, views: Views) -> Result<()> {
        let kinds: Vec<ObjectKind> = self.objects.iter().copied().map(ObjectKind::from).collect();
        let random = RandomScene::of_kinds(self.setting.into(), &kinds, self.seed, number.into(), self.size);
        let shot = random.render(views);
        let what = format!("a random scene, seed {}, number {number}", self.seed);
        output::write_folder(folder, |folder| write_capture(folder, &shot, &random.camera, what))
    }
}

/// Parses the size of a view.
fn view_size(text: &str) -> Result<[u32; 2]> {
    let size = value::size(text).ok().filter(|size| size.iter().all(|side| (16..=4096).contains(side)));
    size.ok_or_else(|| Error::Usage("it must be a width and a height from 16 to 4096, such as 256x192".into()))
}

/// The true disparities of a rendered capture, within its folder.
pub const TRUTH_FILE_NAME: &str = "truth.pfm";

/// The file of the true disparities in a captured folder, if it is there.
pub fn truth_file(folder: &Path) -> Option<PathBuf> {
    Some(folder.join(TRUTH_FILE_NAME)).filter(|path| path.is_file())
}

/// Writes the frames, the truth and `rig.toml` into a folder that is there. `what` says what was rendered.
pub fn write_capture(folder: &Path, shot: &Shot, camera: &PinholeCamera, what: String) -> Result<()> {
    let frames = std::iter::once(Frame::Center).chain(shot.neighbors.keys().copied().map(Frame::View));
    for frame in frames {
        write_png(&folder.join(FrameFiles::name_of(frame)), shot.frame(frame))?;
    }
    multiscopic::files::write_pfm(&shot.truth, &folder.join(TRUTH_FILE_NAME))?;
    rig(camera, shot.neighbors.keys().copied().collect(), what).save(folder)
}

/// The rig of a rendered capture.
pub fn rig(camera: &PinholeCamera, views: Views, what: String) -> Rig {
    let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
    Rig {
        baseline_mm: Some(camera.baseline_mm),
        focal_px: Some(camera.focal_px),
        principal_point: Some([middle(camera.width), middle(camera.height)]),
        doffs: 0.0,
        lens: None,
        mount_rotation_deg: None,
        mount_roll_deg: None,
        sweep: Vec::new(),
        hand_eye: None,
        poses: BTreeMap::new(),
        images: FrameFiles::of_capture(views),
        alignment: None,
        capture: Provenance {
            camera: Some("ray tracer".into()),
            stage: Some("simulated".into()),
            repeatability_mm: Some(camera.repeatability_mm),
            notes: Some(what),
            ..Provenance::default()
        },
    }
}
