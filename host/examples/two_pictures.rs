//! Matches two pictures, of which the second was taken one baseline to the right.
//!
//! ```sh
//! cargo run --release -p multiscopic --example two_pictures -- center.png right.png disparity.pfm
//! ```

use std::{env, path::Path};

use multiscopic::{Engine, Frames, Method, files::FrameFiles};
use multiscopic_core::{Fusion, SearchConfig, View, Views};

/// Disparities from 1 to 60 pixels, by the network.
fn match_pictures(center: &Path, right: &Path, output: &Path) -> multiscopic::Result<()> {
    let files = FrameFiles { center: center.into(), ..FrameFiles::default() }.with(View::RIGHT, right.into());
    let (frames, _) = Frames::load(&files)?;
    let [width, height] = frames.size().map(|side| side as u16);
    let search =
        SearchConfig { views: Views::STEREO, fusion: Fusion::Min, num_disparities: 60, ..SearchConfig::of_size(width, height) }
            .checked()?;
    let disparities = Method::net().disparities(&Engine::new(None, 0)?, &frames, &search, &())?;
    multiscopic::files::write_pfm(&disparities.to_float(), output)
}

fn main() -> multiscopic::Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [center, right, output] = &arguments[..] else {
        return Err(multiscopic::Error::Usage("give CENTER.png RIGHT.png OUT.pfm".into()));
    };
    match_pictures(center.as_ref(), right.as_ref(), output.as_ref())
}

#[test]
fn pictures_become_disparities() {
    let shot = multiscopic::scene::RandomScene::new(7, 0, [256, 192]).render(Views::STEREO);
    let folder = tempfile::tempdir().expect("a folder");
    let files = FrameFiles::of_capture(Views::STEREO).within(folder.path());
    shot.color_frames().save(&files).expect("two pictures");
    let output = folder.path().join("disparity.pfm");
    match_pictures(&files.center, files.right.as_deref().expect("a view"), &output).expect("a match");
    let map = multiscopic::files::read_pfm(&output).expect("disparities");
    let error = |(found, truth): (&f32, &f32)| truth.is_finite().then_some((found - truth).abs());
    let errors: Vec<f32> = map.pixels().iter().zip(shot.truth.pixels()).filter_map(error).collect();
    let mean = errors.iter().sum::<f32>() / errors.len() as f32;
    assert!(mean < 2.0, "a mean error of {mean} pixels");
}
