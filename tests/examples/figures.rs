//! Draws the pictures of README.md and `docs/` anew: `cargo run --release -p multiscopic-tests --example figures`.
//!
//! They are what the commands of the program write for the demo's scene. `docs/pipeline.svg` is drawn by hand.

use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

use image::{DynamicImage, GrayImage, Luma, RgbImage, RgbaImage, imageops};
use multiscopic::{
    DisparityMap,
    images::{montage, turbo},
};
use multiscopic_core::{Frame, View};
use multiscopic_tests::{
    program::Invocation,
    test_images::faults::{FAULTS, Fault, right_frames},
};

/// The greatest width of a picture in a row.
const WIDTH: u32 = 360;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("docs");
    let folder = tempfile::tempdir()?;
    let figures = Figures { docs, folder: folder.path().into() };
    figures.draw_demo()?;
    figures.draw_confidence()?;
    figures.draw_microcontroller()?;
    figures.draw_faults()?;
    figures.draw_failures()
}

/// The folder in which pictures are drawn.
struct Figures {
    docs: PathBuf,
    /// The folder for the outputs of commands.
    folder: PathBuf,
}

impl Figures {
    /// The views of the demo, and what more of them and longer baselines add.
    fn draw_demo(&self) -> Result<()> {
        let demo = |name: &str, options: &str| self.run(&format!("demo {options} -o {}", self.path(name)));
        demo("demo", "")?;
        demo("arrays", "--layout 3x3")?;
        demo("baselines", "--layout 1x3 --baselines 3,5")?;
        demo("all-baselines", "--layout 1x3 --baselines 2,3,4,5")?;
        for (from, to) in [
            ("demo/overview.png", "demo.png"),
            ("arrays/views.svg", "views.svg"),
            ("baselines/views.svg", "baselines.svg"),
            ("all-baselines/errors-over-baselines.svg", "errors-over-baselines.svg"),
        ] {
            fs::copy(self.folder.join(from), self.docs.join(to))?;
        }
        Ok(())
    }

    /// The centre and a view with each of the faults that `docs/faults.md` tells of.
    fn draw_faults(&self) -> Result<()> {
        fs::create_dir_all(self.docs.join("faults"))?;
        for Fault { name, spoil } in FAULTS {
            let frames = spoil(&right_frames());
            let view = if frames.views().contains(View::RIGHT) { View::RIGHT } else { View::TOP };
            let small = |frame| {
                let picture = frames.picture(frame).expect("the frame is there").to_gray();
                DynamicImage::ImageLuma8(picture).thumbnail(160, 120).to_luma8()
            };
            let mut both = GrayImage::from_pixel(324, 120, Luma([255]));
            imageops::replace(&mut both, &small(Frame::Center), 0, 0);
            imageops::replace(&mut both, &small(Frame::View(view)), 164, 0);
            both.save(self.docs.join(format!("faults/{name}.png")))?;
        }
        Ok(())
    }

    /// Disparities by semi-global matching, their confidences, those that are sure, and the smoothed map.
    fn draw_confidence(&self) -> Result<()> {
        // All in the colours of one range: those of a map alone would differ by its outliers.
        let range = self.true_disparities("demo")?.range();
        let confidence = self.path("confidence.png");
        let matched = |name: &str, options: &str| -> Result<RgbImage> {
            let [demo, map] = ["demo".into(), format!("{name}.pfm")].map(|name: String| self.path(&name));
            self.run(&format!("match {demo} --method sgm -o {map} {options}"))?;
            Ok(turbo(&DisparityMap::from_float(&multiscopic::files::read_pfm(Path::new(&map))?), range.clone()))
        };
        let all = matched("all", &format!("--confidence {confidence}"))?;
        let [sure, smooth] = [matched("sure", "--min-confidence 0.9")?, matched("smooth", "--smooth")?];
        self.draw_row("confidence.png", &[all, picture(&confidence)?, sure, smooth])
    }

    /// The view of a microcontroller: the centre image, block matching, semi-global matching.
    fn draw_microcontroller(&self) -> Result<()> {
        self.run(&format!("demo --width 320 --height 240 -o {}", self.path("qvga")))?;
        let mut row = vec![picture(&self.path("qvga/center.png"))?];
        let range = self.true_disparities("qvga")?.range();
        for profile in ["qvga", "qvga-sgm"] {
            let map = self.path(&format!("{profile}.pfm"));
            self.run(&format!("simulate --profile {profile} {} -o {map}", self.path("qvga")))?;
            row.push(turbo(&DisparityMap::from_float(&multiscopic::files::read_pfm(Path::new(&map))?), range.clone()));
        }
        self.draw_row("microcontroller.png", &row)
    }

    /// Made-up scenes in which much cannot be matched: the centre, the truth, what the network makes of it, and how confident
    /// it is.
    fn draw_failures(&self) -> Result<()> {
        let mut rows = Vec::new();
        for (setting, seed) in [("studio", 2006), ("studio", 2015), ("field", 2010)] {
            let [scenes, map, confidence] = [setting, "failure.pfm", "failure.png"].map(|name| self.path(name));
            let scene = format!("{setting}{seed}/0000");
            let sizes = "--count 1 --views 2 --size 384x288";
            self.run(&format!("scene --random --setting {setting} --seed {seed} {sizes} -o {scenes}{seed}"))?;
            let rig = self.path(&scene);
            self.run(&format!("match {rig} --method net --num-disparities 40 -o {map} --confidence {confidence}"))?;
            let truth = self.true_disparities(&scene)?;
            let found = DisparityMap::from_float(&multiscopic::files::read_pfm(Path::new(&map))?);
            let maps = [&truth, &found].map(|map| turbo(map, truth.range()));
            let [truth, found] = maps;
            rows.push(montage::row(
                &[picture(&format!("{rig}/center.png"))?, truth, found, picture(&confidence)?],
                WIDTH / 3 * 2,
            ));
        }
        let height = rows.iter().map(RgbaImage::height).sum();
        let mut all = RgbaImage::new(rows[0].width(), height);
        let mut top = 0;
        for row in &rows {
            image::imageops::replace(&mut all, row, 0, top);
            top += i64::from(row.height());
        }
        Ok(DynamicImage::from(all).into_rgb8().save(self.docs.join("failures.png"))?)
    }

    fn true_disparities(&self, demo: &str) -> Result<DisparityMap> {
        Ok(DisparityMap::from_float(&multiscopic::files::read_pfm(&self.folder.join(demo).join("truth.pfm"))?))
    }

    fn draw_row(&self, name: &str, pictures: &[RgbImage]) -> Result<()> {
        Ok(montage::row(pictures, WIDTH).save(self.docs.join(name))?)
    }

    fn path(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
    }

    /// Runs the program, whose arguments have no spaces.
    fn run(&self, arguments: &str) -> Result<()> {
        let run = Invocation::new(arguments.split_whitespace());
        if run.code == Some(0) { Ok(()) } else { Err(format!("multiscopic {arguments}:\n{}", run.stderr).into()) }
    }
}

fn picture(path: &str) -> Result<RgbImage> {
    Ok(image::open(path)?.into_rgb8())
}
