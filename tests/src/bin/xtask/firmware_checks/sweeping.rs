//! Firmware that refines disparities with each frame of a sweep: runs it, compares its packets with the host's, and measures it. Its
//! prices are fitted to sweeps of other sizes.

use anyhow::{Context, Result, ensure};
use image::GrayImage;
use multiscopic::{
    Picture,
    scene::{PinholeCamera, RandomScene, Scene, render_sweep},
    target::{FirmwareCostTable, MEASURED, Planes, SweepCosts, instruction_model::SweepUnits, simulate_sweep},
};
use multiscopic_core::{Frame, SearchConfig, SearchSpace, SweepOffset, SweepParams, View, Views};
use multiscopic_edge::{
    SweepProfile,
    frame_file::{self, FrameFile},
    profile::QQVGA_SWEEP,
};
use std::{fs, iter, path::Path};

use crate::{
    counts::{self, Counts},
    emulation::{
        self,
        build::{self, Footprint, Program},
        counter::{Counter, Instructions},
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::{
        price_fit::{self, MOST_OFF, least_squares, rounded},
        traced_cost::{self, Cost},
    },
    system,
    tools::Toolchain,
};

/// The name of the example, and of its runs.
pub const NAME: &str = QQVGA_SWEEP.name;
/// The steps of the unit baseline.
const STEPS: i8 = 16;

/// A sweep to run.
struct Sweep {
    profile: SweepProfile,
    /// The frames after which a map is sent.
    every: usize,
    /// The scene and the distance of its frames, in messages.
    scene: String,
    center: GrayImage,
    frames: Vec<(SweepOffset, GrayImage)>,
}

impl Sweep {
    /// The sweep of the profile.
    fn of_profile() -> Sweep {
        Sweep::of_demo(QQVGA_SWEEP.params, 2, 1.0)
    }

    /// A sweep over the scene of the demo, whose frames are so many times as far from each other as those of the profile.
    fn of_demo(params: SweepParams, every: usize, distance: f64) -> Sweep {
        let mut camera = PinholeCamera::new(params.search().width() as u32, params.search().height() as u32);
        camera.baseline_mm *= distance;
        let (center, frames) = render_sweep(&Scene::demo(), &camera, STEPS, 1);
        let scene = format!("the demo with {distance} times the baseline");
        Sweep { profile: SweepProfile { params, ..QQVGA_SWEEP }, every, scene, center, frames }
    }

    /// The same in another size, with as many disparities as it shows there.
    fn new([width, height]: [u16; 2], radius: u8, every: usize, distance: f64) -> Result<Sweep> {
        let num_disparities = 1 + (distance * f64::from(width) / 5.0) as u16;
        let search = SearchConfig { min_disparity: 0, num_disparities, ..SearchConfig::of_size(width, height) }.checked()?;
        let params = SweepParams::new(search, QQVGA_SWEEP.params.noise_q4(), radius)?;
        Ok(Sweep::of_demo(params, every, distance))
    }

    /// A made-up scene instead.
    fn of_scene(self, number: u64) -> Sweep {
        let (width, height) = self.center.dimensions();
        let noisy = RandomScene::new(5, number, [width, height]);
        let camera =
            PinholeCamera { baseline_mm: noisy.camera.baseline_mm / f64::from(STEPS), repeatability_mm: 0.0, ..noisy.camera };
        let made_up = RandomScene { camera, ..noisy.ideal() };
        let gray = |view: View| {
            let shot = made_up.render(Views::NONE.with(view));
            [&shot.center, shot.frame(Frame::View(view))].map(|image| Picture::Rgb(image.clone()).to_gray())
        };
        let [center, _] = gray(View::RIGHT);
        let frames = views().zip(&self.frames).map(|(view, (offset, _))| (*offset, gray(view)[1].clone())).collect();
        Sweep { scene: format!("made-up scene {number}"), center, frames, ..self }
    }

    /// The sweeps that prices are fitted to.
    fn fitted() -> Result<Vec<Sweep>> {
        let sizes = [
            ([96, 72], 2, 2),
            ([96, 72], 2, 32),
            ([64, 96], 1, 32),
            ([128, 48], 3, 32),
            ([144, 108], 1, 2),
            ([80, 60], 3, 2),
            ([48, 120], 2, 32),
            ([152, 104], 3, 32),
        ];
        sizes.into_iter().map(|(size, radius, every)| Sweep::new(size, radius, every, 1.0)).collect()
    }

    /// Other sweeps, on which prices are checked: other sizes, twice as far from frame to frame, and other scenes.
    fn checks() -> Result<Vec<Sweep>> {
        let of_demo = [([120, 90], 2, 4, 1.0), ([160, 96], 1, 2, 1.0), ([100, 75], 3, 8, 1.0), ([128, 96], 2, 2, 2.0)];
        let of_demo = of_demo.into_iter().map(|(size, radius, every, distance)| Sweep::new(size, radius, every, distance));
        of_demo.chain((0..3).map(|number| Ok(Sweep::new([128, 96], 2, 2, 1.0)?.of_scene(number)))).collect()
    }

    fn name(&self) -> String {
        let (params, search) = (&self.profile.params, self.profile.params.search());
        let block = 2 * params.radius() + 1;
        format!("{}x{}, block {block}, a map every {} frames, {}", search.width(), search.height(), self.every, self.scene)
    }

    /// The work of all frames and maps.
    fn work(&self) -> SweepUnits {
        let params = &self.profile.params;
        let frames = 2 * STEPS as usize;
        let [of_frame, of_map] = [SweepUnits::of_frame(params), SweepUnits::of_map(params)].map(|units| units.to_array());
        let maps = frames.div_ceil(self.every) as f64;
        SweepUnits::from_array(std::array::from_fn(|i| frames as f64 * of_frame[i] + maps * of_map[i]))
    }

    /// The instructions at these prices.
    fn predicted(&self, prices: &SweepUnits) -> f64 {
        self.work().to_array().into_iter().zip(prices.to_array()).map(|(count, price)| count * price).sum()
    }

    /// Writes the frames to `folder`, and returns the packets that the firmware must send.
    fn write(&self, folder: &Path) -> Result<Vec<u8>> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let names = iter::once(Frame::Center).chain(views().map(Frame::View));
        let images = iter::once(&self.center).chain(self.frames.iter().map(|(_, image)| image));
        for (frame, image) in names.zip(images) {
            let path = folder.join(FrameFile::new(frame).name().to_str()?);
            fs::write(&path, image.as_raw()).with_context(|| format!("cannot write {}", path.display()))?;
        }
        let size = [self.center.width(), self.center.height()].map(|side| side as usize);
        let planes: Vec<_> = self.frames.iter().map(|(offset, image)| (*offset, Planes::new(size, image.as_raw()))).collect();
        Ok(simulate_sweep(&self.profile, &Planes::new(size, self.center.as_raw()), &planes, self.every, &|| ())?.packets)
    }

    /// Fails unless the packets in `folder` are those expected, but for those that end a map. Returns the depth of the stack.
    fn compare(&self, folder: &Path, expected: &[u8]) -> Result<usize> {
        let found = fs::read(folder.join(frame_file::PACKETS.to_str()?))?;
        same_lines(&found, expected, self.profile.params.search())
    }

    /// The arguments of the firmware of any sweep.
    fn arguments(&self) -> Vec<String> {
        let (params, search) = (&self.profile.params, self.profile.params.search());
        [search.width(), search.height(), search.num_disparities(), params.radius(), self.every]
            .map(|number| number.to_string())
            .to_vec()
    }
}

/// The views of the steps, in the order of the firmware.
fn views() -> impl Iterator<Item = View> {
    (1..=STEPS).flat_map(|step| [step, -step]).filter_map(|step| View::new(step, 0).ok())
}

/// Builds the firmware for these boards, runs it, and reports.
pub fn run(toolchain: &Toolchain, boards: &[&EmulatedBoard], update: bool) -> Result<()> {
    let sweep = Sweep::of_profile();
    let counter = Counter::build()?;
    let mut table = MEASURED.clone();
    let mut counts = Counts::new();
    for board in boards {
        let image = build::build(toolchain, board, &[Program::Example(NAME)])?.pop().context("one program gives one image")?;
        let folder = system::edge_target().join("runs").join(board.name).join(NAME);
        let expected = sweep.write(&folder)?;
        let name = format!("{NAME} on {}", board.name);
        let functions = traced_cost::traced(board, &image, &folder, &counter).with_context(|| format!("edge: {name}"))?;
        let stack = sweep.compare(&folder, &expected).context(name.clone())?;
        let total: Cost = functions.values().copied().sum();
        let frames = 2.0 * f64::from(STEPS);
        let pixels = frames * sweep.center.len() as f64;
        traced_cost::print(&name, total, &functions, pixels, "pixel of each frame");
        let footprint = Footprint::of(&image)?;
        let (statics, flash) = (footprint.ram() as usize, footprint.flash() as usize);
        println!(
            "edge: {name}: identical to this machine; {:.1} million cycles a frame; RAM {statics} + {stack} bytes, flash {flash}",
            total.cycles as f64 / frames / 1e6
        );
        if update {
            let costs = fit(toolchain, board, &counter, &table).with_context(|| name.clone())?;
            let mut costs = SweepCosts { stack: (stack + 32).next_multiple_of(64), flash, ..costs };
            costs.cycles_per_instruction.insert(board.processor.name().into(), rounded(total.cycles_per_instruction()));
            table.of_mut(board.processor).sweep = Some(costs);
        }
        let noted = table.of(board.processor);
        let costs = noted.sweep.as_ref().with_context(|| format!("{name}: it has no prices: run it with --update"))?;
        let predicted = sweep.predicted(&costs.prices);
        let off = 100.0 * (predicted / total.instructions as f64 - 1.0);
        println!("edge: {name}: {} instructions, `budget` predicts {predicted:.0} ({off:+.1} %)", total.instructions);
        ensure!(off.abs() <= MOST_OFF, "{name}: the prices of `budget` are off: run it with --update");
        let expected = QQVGA_SWEEP.lengths().bytes() + noted.statics;
        ensure!(statics == expected, "{name}: {statics} bytes of statics, the formula says {expected}");
        ensure!(
            stack <= costs.stack && flash <= costs.flash + costs.flash / 50,
            "{name}: {stack} bytes of stack and {flash} of flash, budgets are made with {} and {}: run it with --update",
            costs.stack,
            costs.flash
        );
        for (memory, taken, most) in
            [("RAM", statics + stack, QQVGA_SWEEP.ram_budget), ("flash", flash, QQVGA_SWEEP.flash_budget)]
        {
            ensure!(taken <= most, "{name}: {taken} bytes of {memory}, at most {most}");
        }
        let [instructions, cycles] = [total.instructions, total.cycles].map(|count| count as f64 / pixels);
        let numbers = [("instructions per pixel", instructions), ("cycles per pixel", cycles), ("bytes of stack", stack as f64)];
        counts.extend(numbers.into_iter().map(|(what, count)| (format!("{}, {what}", board.name), count)));
    }
    if update {
        price_fit::write(&table)?;
    }
    counts::SWEEP.hold(&counts, update, &format!("cargo xtask edge --profile {NAME} --update"))
}

/// The costs of a board with fitted prices, and how far they are off for other sweeps. Boards with the instructions of the Cortex-M7, or
/// nearly, have its prices.
fn fit(toolchain: &Toolchain, board: &EmulatedBoard, counter: &Counter, table: &FirmwareCostTable) -> Result<SweepCosts> {
    let costs = table.of(board.processor).sweep.clone().unwrap_or_default();
    if ![emulated_board::M7.name, emulated_board::VECTORS.name].contains(&board.name) {
        let prices = table.of(emulated_board::M7.processor).sweep.as_ref().map(|costs| costs.prices);
        return Ok(SweepCosts { prices: prices.context("the prices of the Cortex-M7 come first")?, ..costs });
    }
    let image = build::build(toolchain, board, &[Program::Example("sweeps")])?.pop().context("one program gives one image")?;
    let count = |sweep: &Sweep| -> Result<f64> {
        let folder = system::edge_target().join("runs").join(board.name).join("sweeps");
        let expected = sweep.write(&folder)?;
        let arguments = sweep.arguments();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let exit = emulation::run(board, &image, &arguments, &folder, Some(&counter.plugin(&image)?))?;
        ensure!(exit.code == 0, "the firmware ended with exit code {} and printed:\n{}", exit.code, exit.output);
        sweep.compare(&folder, &expected).with_context(|| sweep.name())?;
        Ok(Instructions::read(&folder)?.pipeline() as f64)
    };
    let (fitted, checks) = (Sweep::fitted()?, Sweep::checks()?);
    let counted = fitted.iter().map(count).collect::<Result<Vec<_>>>()?;
    let rows: Vec<_> = fitted.iter().map(|sweep| sweep.work().to_array().to_vec()).collect();
    let prices = least_squares(&rows, &counted, &[]);
    let prices = SweepUnits::from_array(std::array::from_fn(|i| rounded(prices[i])));
    println!("edge: prices of sweeps on {}: {prices:?}", board.name);
    let others = checks.iter().map(count).collect::<Result<Vec<_>>>()?;
    for (kind, sweep, counted) in fitted
        .iter()
        .zip(counted)
        .map(|(sweep, counted)| ("fitted", sweep, counted))
        .chain(checks.iter().zip(others).map(|(sweep, counted)| ("other", sweep, counted)))
    {
        let off = 100.0 * (sweep.predicted(&prices) / counted - 1.0);
        println!("edge: {kind:>6}: {counted:>12.0} instructions, {off:>+5.1} % predicted: {}", sweep.name());
    }
    Ok(SweepCosts { prices, ..costs })
}

/// Fails unless both have the same packets, but for those that end a map. Returns the depth of the stack that the last tells.
fn same_lines(found: &[u8], expected: &[u8], search: &SearchSpace) -> Result<usize> {
    let of_map = search.height() + 1;
    let split = |bytes: &[u8]| bytes.split_inclusive(|&byte| byte == 0).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let (found, expected) = (split(found), split(expected));
    ensure!(found.len() == expected.len(), "{} packets were received, {} were expected", found.len(), expected.len());
    for (n, (found, expected)) in found.chunks(of_map).zip(expected.chunks(of_map)).enumerate() {
        super::frames::same_lines(&found.concat(), &expected.concat()).with_context(|| format!("map {n}"))?;
    }
    let last = found.chunks(of_map).next_back().context("no map")?.concat();
    super::frames::whole(&last, Path::new("the last map"), search)?.stack.context("the firmware did not measure its stack")
}
