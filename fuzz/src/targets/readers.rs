//! Readers of files and of the values of options.

use std::{collections::BTreeMap, fmt::Display, fs::File, os::unix::fs::FileExt, path::PathBuf, str::FromStr, sync::Mutex};

use arbitrary::{Arbitrary, Unstructured};
use multiscopic::{
    CameraModel, Dataset, Picture, Rig,
    capture::{Accuracy, Imperfections, stage::StageSpec},
    evaluation::CameraSteps,
    files::{Limits, read_pfm, read_prior},
    images::{ImageRegion, Layout},
    lens::{Mount, Undistortion},
    stereo::{
        cost::mccnn::{Architecture, Weights, checkpoint, package},
        network::DisparityNetwork,
    },
};
use multiscopic_core::View;
use tempfile::TempDir;

/// Tries calibrations of lenses, as TOML and as the YAML of other programs.
pub fn calibrations(bytes: &[u8]) -> bool {
    for name in ["calibration.toml", "calibration.yaml"] {
        if let Ok(camera) = CameraModel::read(&file(name, bytes)) {
            // What was read can be used.
            let undistortion = Undistortion::new(
                &camera,
                &Mount { rotation_deg: [0.5, -1.0, 2.0], focal_px: None, rotation_deviation_deg: None },
                [8, 6],
            );
            let _ = (undistortion.place(3, 2), camera.direction([3.0, 2.0]), camera.pixel([0.1, -0.2]));
        }
    }
    true
}

/// Tries pictures, maps of numbers and disparity maps.
pub fn pictures(bytes: &[u8]) -> bool {
    let path = file("picture", bytes);
    let _ = Picture::read(&path);
    let _ = Picture::brightest(&[&path], Limits::DEFAULT);
    let _ = read_pfm(&path);
    let _ = read_prior(&path, [13, 9], Limits::DEFAULT);
    true
}

/// Tries `rig.toml`, and the other TOML files of a rig.
pub fn rigs(bytes: &[u8]) -> bool {
    let path = file(Rig::FILE_NAME, bytes);
    let _ = Mount::read(&path);
    let _ = Imperfections::read(&path);
    if let Ok(rig) = Rig::load(path.parent().expect("a folder")) {
        // What was read can be used.
        let _ = (rig.geometry([640, 480]), rig.principal_point([640, 480]), rig.images.views());
    }
    true
}

/// Tries weights of networks: safetensors, wheels, files of PyTorch, and the format of our own.
pub fn weights(bytes: &[u8]) -> bool {
    let path = file("weights", bytes);
    let _ = Weights::read(&path, Architecture::Fast);
    let _ = package::read(&path);
    let _ = checkpoint::model(bytes);
    let _ = DisparityNetwork::new(bytes);
    true
}

/// Tries values of options on the command line.
pub fn option_values(bytes: &[u8]) -> bool {
    let Ok(text) = <&str>::arbitrary_take_rest(Unstructured::new(bytes)) else { return false };
    parse::<View>(text);
    parse::<Dataset>(text);
    parse::<Layout>(text);
    parse::<StageSpec>(text);
    let _ = text.parse::<CameraSteps>();
    let _ = text.parse::<ImageRegion>();
    let _ = text.parse::<Accuracy>();
    true
}

/// Parses a value. What is accepted is accepted again as it is printed.
fn parse<T: FromStr + Display>(text: &str) {
    if let Ok(value) = text.parse::<T>() {
        let printed = value.to_string();
        assert!(printed.parse::<T>().is_ok_and(|again| again.to_string() == printed), "{text:?} is printed as {printed:?}");
    }
}

/// Writes a file with this name and these contents, for readers that take a path. The next one of this name replaces it.
fn file(name: &'static str, contents: &[u8]) -> PathBuf {
    static FILES: Mutex<Option<Files>> = Mutex::new(None);
    let files = &mut *FILES.lock().expect("no failure before");
    let new = || Files { folder: tempfile::tempdir().expect("a temporary folder"), open: BTreeMap::new() };
    let Files { folder, open } = files.get_or_insert_with(new);
    let path = folder.path().join(name);
    let file = open.entry(name).or_insert_with(|| File::create(&path).expect("a temporary file"));
    file.set_len(contents.len() as u64).and_then(|()| file.write_all_at(contents, 0)).expect("a temporary file");
    path
}

/// Files of this process, by their names. They stay open: to make one again takes longer than most readers do.
///
/// libFuzzer ends the process without running destructors, so one folder stays behind.
struct Files {
    folder: TempDir,
    open: BTreeMap<&'static str, File>,
}
