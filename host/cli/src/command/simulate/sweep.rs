//! The firmware's pipeline over the frames of a sweep.

use std::{fmt, fs, path::Path, process::ExitCode};

use image::{GrayImage, imageops};
use multiscopic::{
    Error, Picture, Result,
    files::output,
    scene::{PinholeCamera, Scene, render_sweep},
    stereo::confidence_map,
    target::{
        Planes, Ram, Simulation,
        reception::{self, ReceivedFrame},
        simulate_sweep,
    },
};
use multiscopic_core::{Frame, SweepOffset, View};
use multiscopic_edge::SweepProfile;
use serde::Serialize;

use super::{Simulate, check_size};
use crate::command::{advice, limits, options::output_file, terminal};

/// The frames after which a map is sent: one of each side, in the sweep that is rendered.
const EVERY: usize = 2;

/// The centre of a sweep, the places and the frames, and `"demo"` or `"given"` for the report.
type SweepFrames = (GrayImage, Vec<(SweepOffset, GrayImage)>, &'static str);

impl Simulate {
    /// Runs the command for the profile of a sweep.
    pub(super) fn run_sweep(&self, profile: &SweepProfile) -> Result<ExitCode> {
        if self.fusion.is_some() {
            return Err(Error::Usage("--fusion is not for sweeps: leave it out".into()));
        }
        let ram = Ram::of_sweep(&profile.params, self.core);
        let ram =
            ram.ok_or_else(|| Error::Usage(format!("sweeps were not measured on {}: leave --core out", self.core.name())))?;
        let (center, frames, images) = self.sweep_frames(profile)?;

        let size = [center.width(), center.height()].map(|side| side as usize);
        let planes: Vec<_> = frames.iter().map(|(offset, image)| (*offset, Planes::new(size, image.as_raw()))).collect();
        let passes = 2 * frames.len() + frames.len().div_ceil(EVERY);
        let bar = terminal::progress((passes * size[1]) as u64, "lines");
        let simulation = simulate_sweep(profile, &Planes::new(size, center.as_raw()), &planes, EVERY, &|| bar.inc(1))?;
        bar.finish_and_clear();
        let maps = received(&simulation, frames.len())?;
        let (_, last) = maps.last().expect("a sweep has frames");
        self.maps
            .iter()
            .try_for_each(|dir| fs::create_dir_all(dir).map_err(|source| Error::Write { path: dir.clone(), source }))?;
        output::write_together(|| {
            if let Some(path) = &self.packets {
                output::write(path, |writer| writer.write_all(&simulation.packets))?;
            }
            if let Some(path) = &self.output {
                output_file::write_floats(&last.disparities.to_float(), path, "disparity")?;
            }
            if let (Some(path), Some(confidences)) = (&self.confidence, &last.confidences) {
                Picture::from(confidences).write_png(path)?;
            }
            for (dir, (count, map)) in self.maps.iter().flat_map(|dir| maps.iter().map(move |map| (dir, map))) {
                output_file::write_floats(&map.disparities.to_float(), &dir.join(format!("{count:03}.pfm")), "disparity")?;
            }
            Ok(())
        })?;
        advice::no_disparity(&last.disparities).into_iter().for_each(terminal::warn);
        let report = SweepReport {
            profile: profile.name,
            core: self.core.name(),
            images,
            ram_static: ram.statics(),
            stack_max: ram.stack,
            ram_total: ram.bytes(),
            ram_budget: profile.ram_budget,
            frames: frames.len(),
            center_lines_read: simulation.lines_read.iter().map(|(_, lines)| lines).sum(),
            maps: maps.iter().map(SentMap::new).collect(),
            packet_bytes: simulation.packets.len(),
        };
        terminal::print_report(&report, self.json)?;
        Ok(ExitCode::SUCCESS)
    }

    /// The frames in the size of the profile, from the centre outwards.
    fn sweep_frames(&self, profile: &SweepProfile) -> Result<SweepFrames> {
        let (outputs, search) = (self.outputs(), profile.params.search());
        let size = [search.width(), search.height()];
        let Some(mut source) = self.source.source()? else {
            output::check(&outputs, &[])?;
            let camera = PinholeCamera::new(size[0] as u32, size[1] as u32);
            let (center, frames) = render_sweep(&Scene::demo(), &camera, View::MAX_OFFSET, 1);
            return Ok((center, frames, "demo"));
        };
        output::check(&outputs, &source.paths().collect::<Vec<_>>())?;
        let Some(loaded) = source.load_sweep()? else {
            let message = format!(
                "profile {} needs the folder of a sweep, as `multiscopic capture --sweep` makes it: these are views",
                profile.name
            );
            return Err(Error::Usage(message));
        };
        check_size(loaded.swept.frames.size(), size, source.images.center, profile.name)?;
        let center = loaded.swept.frames.get(Frame::Center).expect("frames have a centre");
        let middle = |image: &GrayImage| {
            let [left, top] = [image.width() - size[0] as u32, image.height() - size[1] as u32].map(|rest| rest / 2);
            imageops::crop_imm(image, left, top, size[0] as u32, size[1] as u32).to_image()
        };
        let frames = loaded.swept.placed.iter().map(|(offset, image)| (*offset, middle(image))).collect();
        Ok((middle(center), frames, "given"))
    }
}

/// The maps of the packets, and how many of the frames came before each.
fn received(simulation: &Simulation, frames: usize) -> Result<Vec<(usize, ReceivedFrame)>> {
    let mut packets = &simulation.packets[..];
    let counts = (1..=frames).filter(|count| count % EVERY == 0 || *count == frames);
    let map = |count| Ok((count, reception::receive(&mut packets, Path::new("the simulated packets"), limits(), |_| ())?));
    counts.map(map).collect()
}

/// The simulation. `--json` prints these fields, named as for other profiles.
#[derive(Debug, Serialize)]
struct SweepReport {
    profile: &'static str,
    core: &'static str,
    images: &'static str,
    ram_static: usize,
    stack_max: usize,
    ram_total: usize,
    ram_budget: usize,
    frames: usize,
    /// Lines of the centre that were read, for all frames and maps.
    center_lines_read: usize,
    maps: Vec<SentMap>,
    packet_bytes: usize,
}

/// A map. Shares are from 0 to 1.
#[derive(Debug, Serialize)]
struct SentMap {
    /// The frames before it.
    frames: usize,
    /// The share of pixels with a disparity.
    valid: f64,
    /// The share with a confidence from 0.9 on.
    sure: f64,
}

impl SentMap {
    fn new((frames, map): &(usize, ReceivedFrame)) -> SentMap {
        let pixels = map.disparities.pixels();
        let valid = pixels.iter().flatten().count() as f64 / pixels.len() as f64;
        SentMap { frames: *frames, valid, sure: map.confidences.as_ref().map_or(0.0, confidence_map::sure_share) }
    }
}

impl fmt::Display for SweepReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SweepReport { profile, core, images, ram_static, stack_max, ram_total, ram_budget, .. } = self;
        writeln!(f, "profile {profile}, frames {images}, processor {core}")?;
        writeln!(f, "RAM      {ram_total} of {ram_budget} bytes: {ram_static} statics, {stack_max} stack")?;
        writeln!(
            f,
            "lines    {} of the centre read, for {} frames and {} maps",
            self.center_lines_read,
            self.frames,
            self.maps.len()
        )?;
        for SentMap { frames, valid, sure } in &self.maps {
            writeln!(f, "map      after {frames} frames: {:.1} % valid{}", 100.0 * valid, terminal::sure(*sure))?;
        }
        writeln!(f, "packets  {} bytes", self.packet_bytes)
    }
}
