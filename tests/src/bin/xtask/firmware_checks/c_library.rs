//! The library for C: the same matches in C on each kind of processor as here, bit for bit, and the builds that users have.

use anyhow::{Context, Result, ensure};
use multiscopic_core::{
    BlockMatchingParams, Census, ConfidenceLines, ConfidenceTable, Disparity, Frame, Fusion, Matcher, Memory, PathPenalties,
    Region, ScanlineSource, SearchConfig, SemiGlobalCost, SemiGlobalMatcher, SemiGlobalParams, View, Views, kernel::Portable,
};
use multiscopic_edge::{
    packet::{self, Content, Packet, Receiver},
    state_pointers,
};
use multiscopic_reference::split_mix::Random;
use std::{
    convert::Infallible,
    fs, iter,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    emulation::{
        self,
        build::Footprint,
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::{folder, has_map_of_scene},
    system::{self, read, run},
    tools::{self, Tool, Toolchain},
};

/// The folder of the library.
const FOLDER: &str = "edge/c";
/// The library that cargo builds.
const ARCHIVE: &str = "libmultiscopic_c.a";
/// The start of a program on an emulated board, in C.
const BOARD: &str = "tests/bare/board.c";
/// The most `.text` of the example, two views of 160x120 pixels with 16 disparities, on the reference board.
const MAP_TEXT: u64 = 48 * 1024;
/// A method for each number of views, and those for any number.
const VIEWS: [&str; 5] = ["1", "2", "3", "4", ""];

/// A processor that programs in C are compiled for.
struct Target {
    /// The board that they run on, or none for this machine.
    board: Option<&'static EmulatedBoard>,
    compiler: Tool,
    /// Options that choose the processor.
    options: &'static [&'static str],
    /// The linker script that sets the board's memory, before `memory.x`.
    memory: Option<&'static str>,
}

const CORTEX_M4: Target = Target {
    board: Some(&emulated_board::REFERENCE),
    compiler: tools::ARM_CC,
    options: &["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"],
    memory: None,
};
const CORTEX_M55: Target = Target {
    board: Some(&emulated_board::VECTORS),
    compiler: tools::ARM_CC,
    options: &["-mcpu=cortex-m55", "-mfloat-abi=hard"],
    memory: Some("edge/firmware/boards/an547.x"),
};
const RISC_V: Target = Target {
    board: Some(&emulated_board::RISC_V),
    compiler: tools::RISC_V_CC,
    options: &["-march=rv32imac", "-mabi=ilp32", "-Wl,--no-relax"],
    memory: Some("edge/firmware/boards/rp2350-riscv.x"),
};
const HOST: Target = Target { board: None, compiler: tools::CXX, options: &[], memory: None };

/// Compares the library in C on the reference board and on this machine; `everywhere` also on a Cortex-M55 and a RISC-V, and with
/// the builds of others.
pub fn run_tests(toolchain: &Toolchain, everywhere: bool) -> Result<()> {
    let folder = folder("c")?;
    let cases = Case::all(&mut Random(46));
    fs::write(folder.join("cases.h"), header(&cases)?)?;
    let few = [&CORTEX_M4, &HOST];
    let more = [&CORTEX_M55, &RISC_V];
    for target in few.into_iter().chain(more.into_iter().filter(|_| everywhere)) {
        target.build_archive(toolchain)?;
        target.compare(&folder, &cases).with_context(|| format!("in C on {}", target.name()))?;
        target.print_map(&folder).with_context(|| format!("the map in C on {}", target.name()))?;
    }
    let text = Footprint::of(&folder.join("map-Cortex-M4F"))?.text;
    ensure!(text <= MAP_TEXT, "the map in C has {text} bytes of text, and may have {MAP_TEXT}");
    println!("c: the map on a Cortex-M4F has {text} bytes of text");
    if everywhere {
        cmake(&folder)?;
        meson(toolchain, &folder)?;
        arduino(&folder)?;
    }
    Ok(())
}

impl Target {
    fn name(&self) -> &'static str {
        self.board.map_or("this machine", |board| board.core)
    }

    /// The library.
    fn archive(&self) -> PathBuf {
        let target = self.board.map_or("", |board| board.target);
        system::edge_target().join(target).join("firmware").join(ARCHIVE)
    }

    fn build_archive(&self, toolchain: &Toolchain) -> Result<()> {
        let mut cargo = toolchain.cargo("build");
        cargo.args(["--profile", "firmware", "--package", "multiscopic-c"]);
        match self.board {
            Some(board) => cargo.args(["--target", board.target]).env("RUSTFLAGS", board.rustflags),
            // Its code has tests of its own. Here, it shows that the header is right on 64 bits and in C++.
            None => cargo.args(["--config=profile.firmware.opt-level=1", "--config=profile.firmware.lto=\"off\""]),
        };
        run(&mut cargo)
    }

    /// Compiles `sources` of the library's folder, the first in `language` and the others in C, and links them with it. All
    /// warnings are errors.
    fn compile(&self, language: &str, sources: &[&str], folder: &Path, program: &Path) -> Result<()> {
        let compiler = self.compiler.install()?;
        let mut cc = compiler.command(&["-Os", "-Wall", "-Wextra", "-Wpedantic", "-Werror"])?;
        let library = system::root().join(FOLDER);
        cc.args((language == "c").then_some("-std=c99")).args(self.options);
        cc.arg("-I").arg(library.join("include")).arg("-I").arg(folder);
        if self.board.is_some() {
            cc.args(["-ffreestanding", "-ffunction-sections", "-I"]).arg(library.join("tests/bare"));
        }
        for (source, language) in sources.iter().zip(iter::once(language).chain(iter::repeat("c"))) {
            cc.args(["-x", language]).arg(library.join(source));
        }
        cc.args(["-x", "none"]).arg(self.archive());
        if self.board.is_some() {
            cc.args(["-nostdlib", "-Wl,--gc-sections"]).args(self.memory.map(|script| format!("-Wl,-T,{script}")));
            cc.args(["-Wl,-T,memory.x", "-Wl,-T"]).arg(library.join("tests/bare/sections.ld"));
        }
        run(cc.arg("-o").arg(program))
    }

    /// Runs the cases in C, and compares every line with that of the core.
    fn compare(&self, folder: &Path, cases: &[Case]) -> Result<()> {
        let program = folder.join("frames");
        let packets = match self.board {
            Some(board) => {
                self.compile("c", &["tests/frames.c", BOARD], folder, &program)?;
                let exit = emulation::run(board, &program, &[], folder, None)?;
                ensure!(exit.code == 0, "line {} of frames.c failed: {}", exit.code, exit.output);
                fs::read(folder.join("frames.packets"))?
            }
            None => {
                let of_language = |language: &str| -> Result<Vec<u8>> {
                    self.compile(language, &["tests/frames.c", "tests/host.c"], folder, &program)?;
                    let output = Command::new(&program).output()?;
                    ensure!(output.status.success(), "line {:?} of frames.c failed, as {language}", output.status.code());
                    Ok(output.stdout)
                };
                let packets = of_language("c")?;
                ensure!(packets == of_language("c++")?, "C and C++ differ");
                packets
            }
        };
        let mut packets = packets.split(|byte| *byte == 0);
        for (index, case) in cases.iter().enumerate() {
            case.compare(&mut packets).with_context(|| format!("case {index}, {}", case.method))?;
        }
        println!("c: {} matches on {} are those of the core", cases.len(), self.name());
        Ok(())
    }

    /// Runs the example, which cannot panic.
    fn print_map(&self, folder: &Path) -> Result<()> {
        let program = folder.join(format!("map-{}", self.name().replace(' ', "-")));
        let output = match self.board {
            Some(board) => {
                self.compile("c", &["examples/map.c", BOARD], folder, &program)?;
                let text = fs::read(&program)?;
                ensure!(!text.windows(9).any(|bytes| bytes == b"panicking"), "a panic is linked");
                emulation::run(board, &program, &[], folder, None)?.output
            }
            None => {
                self.compile("c", &["examples/map.c"], folder, &program)?;
                read(&mut Command::new(&program))?
            }
        };
        has_map_of_scene(&output)
    }
}

/// A match of both sides.
struct Case {
    method: String,
    matching: Matching,
    region: Option<Region>,
    is_pushed: bool,
}

enum Matching {
    Blocks(BlockMatchingParams),
    Paths(SemiGlobalParams),
}

/// The number of a line, its disparities, and its confidences if there are any.
type Line = (usize, Vec<Option<Disparity>>, Vec<u8>);

impl Case {
    /// One for each method, with random parameters.
    fn all(random: &mut Random) -> Vec<Case> {
        let methods = VIEWS.iter().flat_map(|views| ["bm", "sgm"].map(|method| (method, *views)));
        let methods = methods.flat_map(|method| ["", "_confidence"].map(|confidence| (method, confidence)));
        methods.map(|((method, views), confidence)| Case::random(method, views, confidence, random)).collect()
    }

    fn random(method: &str, views: &str, confidence: &str, random: &mut Random) -> Case {
        let number = views.parse().unwrap_or(1 + random.below(4));
        let mut chosen = Views::NONE;
        while chosen.len() < number {
            let [right, down] = [0; 2].map(|_| random.below(5) as i8 - 2);
            chosen = View::new(right, down).map_or(chosen, |view| chosen.with(view));
        }
        let has_census = method == "sgm" && views.is_empty();
        let rules = if has_census { &Fusion::ALL[..] } else { &Fusion::OF_ANY_COSTS };
        let search = SearchConfig {
            width: 30 + random.below(40) as u16,
            height: 20 + random.below(20) as u16,
            views: chosen,
            fusion: rules[random.below(rules.len())],
            min_disparity: random.below(5) as i16 - 2,
            num_disparities: 1 + random.below(20) as u16,
        }
        .checked()
        .expect("a valid search");
        let ratio = Some(random.below(20) as u8).filter(|percent| *percent > 0);
        let matching = if method == "bm" {
            let block = 1 + 2 * random.below(if views.is_empty() { 11 } else { 8 }) as u8;
            let params = BlockMatchingParams::block_matching(search, block).expect("a valid block");
            Matching::Blocks(params.with_uniqueness_ratio(ratio))
        } else {
            let cost = match has_census {
                true => SemiGlobalCost::Census(Census::ALL[random.below(3)]),
                false => SemiGlobalCost::Sad { block_size: 1 + 2 * random.below(6) as u8 },
            };
            let p1 = random.below(20) as u8;
            let edge = Some(random.below(30) as u8).filter(|edge| *edge > 0);
            let penalties = match random.below(2) {
                0 => cost.default_penalties(number),
                _ => PathPenalties::new(p1, p1 + 1 + random.below(30) as u8, edge).expect("valid penalties"),
            };
            let params = SemiGlobalParams::with_penalties(search, cost, penalties).expect("valid costs");
            Matching::Paths(params.with_uniqueness_ratio(ratio))
        };
        let mut part = |length: usize| {
            let start = random.below(length);
            start..start + 1 + random.below(length - start)
        };
        let (columns, rows) = (part(search.width()), part(search.height()));
        let region = (method == "bm" && confidence.is_empty()).then(|| Region::new(&search, columns, rows).expect("a region"));
        let is_pushed = random.below(2) == 1;
        Case { method: format!("multiscopic_{method}{views}{confidence}"), matching, region, is_pushed }
    }

    fn has_confidences(&self) -> bool {
        self.method.ends_with("confidence")
    }

    fn search(&self) -> &multiscopic_core::SearchSpace {
        match &self.matching {
            Matching::Blocks(params) => params.search(),
            Matching::Paths(params) => params.search(),
        }
    }

    fn region(&self) -> Region {
        self.region.unwrap_or(Region::whole(self.search()))
    }

    /// The words that it takes on any processor.
    fn memory_words(&self) -> usize {
        let (width, confidences) = (self.search().width(), usize::from(self.has_confidences()));
        let matcher = match &self.matching {
            Matching::Blocks(params) => Memory::new::<Portable<8>>(params, width).words(),
            Matching::Paths(params) => Memory::semi_global::<Portable<8>>(params).words(),
        };
        2 * state_pointers(Views::MAX_MATCHED) + matcher + confidences * ConfidenceLines::memory_words(width)
    }

    /// The lines that the core computes.
    fn lines(&self) -> Result<Vec<Line>> {
        let (mut memory, mut lines_memory) = (vec![0; self.memory_words()], vec![0; self.memory_words()]);
        let region = self.region();
        let (mut disparities, mut confidences) = (vec![None; region.width()], vec![0; region.width()]);
        let mut lines = Vec::new();
        macro_rules! run {
            ($matcher:expr, $table:expr) => {{
                let mut matcher = $matcher?;
                if self.has_confidences() {
                    let mut of_lines = ConfidenceLines::new(self.search(), $table, &mut lines_memory)?;
                    while let Some(v) = of_lines.next_line(
                        |disparities, peaks| matcher.next_line_and_peaks(&mut Scene, disparities, peaks),
                        &mut disparities,
                        &mut confidences,
                    )? {
                        lines.push((v, disparities.clone(), confidences.clone()));
                    }
                } else {
                    while let Some(v) = matcher.next_line(&mut Scene, &mut disparities)? {
                        lines.push((v, disparities.clone(), Vec::new()));
                    }
                }
            }};
        }
        match &self.matching {
            Matching::Blocks(params) => {
                run!(Matcher::with_isa(Portable::<8>, params, &region, &mut memory), &ConfidenceTable::BLOCK_MATCHING);
            }
            Matching::Paths(params) => {
                run!(SemiGlobalMatcher::with_isa(Portable::<8>, params, &mut memory), &ConfidenceTable::SEMI_GLOBAL);
            }
        }
        Ok(lines)
    }

    /// Compares the next packets of `sent` with the lines of the core.
    fn compare<'a>(&self, sent: &mut impl Iterator<Item = &'a [u8]>) -> Result<()> {
        let (region, mut receiver) = (self.region(), Receiver::default());
        let (left, columns) = (region.columns().start as u16, region.width() as u16);
        for (v, disparities, confidences) in self.lines()? {
            let mut bytes = sent.next().context("packets are missing")?.to_vec();
            let packet = Packet::decode(&mut bytes)?;
            receiver.accept(&packet.header)?;
            let expected = match self.has_confidences() {
                true => Content::LineWithConfidences { line: v as u16, left, columns },
                false => Content::Line { line: v as u16, left, columns },
            };
            ensure!(packet.header.content == expected, "{:?} instead of {expected:?}", packet.header.content);
            ensure!(packet.disparities().eq(disparities), "line {v} has other disparities");
            ensure!(packet.confidences() == confidences, "line {v} has other confidences");
        }
        let mut end = sent.next().context("the end is missing")?.to_vec();
        ensure!(Packet::decode(&mut end)?.header.content == Content::End { stack: None }, "the end is not one");
        Ok(())
    }

    /// The case in C.
    fn in_c(&self) -> String {
        let search = self.search().config();
        let views: Vec<_> = search.views.iter().map(|view| (view.right(), view.down())).collect();
        let views = (0..8).map(|k| views.get(k).copied().unwrap_or_default());
        let views: String = views.map(|(right, down)| format!("{{{right}, {down}}}, ")).collect();
        let fusion = Fusion::ALL.iter().position(|fusion| *fusion == search.fusion).unwrap_or_default();
        let (block, census, [p1, p2, edge], ratio) = match &self.matching {
            Matching::Blocks(params) => (params.block_size(), 0, [0; 3], params.uniqueness_ratio()),
            Matching::Paths(params) => {
                let (block, census) = match params.cost() {
                    SemiGlobalCost::Sad { block_size } => (usize::from(block_size), 0),
                    SemiGlobalCost::Census(census) => {
                        (0, 1 + Census::ALL.iter().position(|other| *other == census).unwrap_or_default())
                    }
                };
                let penalties = params.penalties();
                let is_default = penalties == params.cost().default_penalties(search.views.len());
                let stated = [penalties.p1(), penalties.p2(0), penalties.p2_edge().unwrap_or(0)];
                (block, census, if is_default { [0; 3] } else { stated }, params.uniqueness_ratio())
            }
        };
        let region = self.region();
        format!(
            "    {{&{}, {{{}, {}, {}, {}, {{{views}}}, {}, {fusion}, {block}, {}, {census}, {p1}, {p2}, {edge}}}, {}, {{{}, {}, {}, {}}}, \
             {}, {}}},\n",
            self.method,
            search.width,
            search.height,
            search.min_disparity,
            search.num_disparities,
            search.views.len(),
            ratio.unwrap_or(0),
            u8::from(self.region.is_some()),
            region.columns().start,
            region.rows().start,
            region.width(),
            region.height(),
            u8::from(self.has_confidences()),
            u8::from(self.is_pushed),
        )
    }
}

/// `cases.h`.
fn header(cases: &[Case]) -> Result<String> {
    let words = cases.iter().map(Case::memory_words).max().context("there are cases")?;
    let columns = cases.iter().map(|case| case.search().width()).max().context("there are cases")?;
    let bytes = packet::buffer_bytes_with_confidences(columns);
    let all: String = cases.iter().map(Case::in_c).collect();
    Ok(format!(
        "typedef struct test_case {{\n    const multiscopic_method *method;\n    multiscopic_params params;\n    int has_region;\n    \
         multiscopic_region region;\n    int has_confidences;\n    int is_pushed;\n}} test_case;\n\n#define MEMORY_WORDS {words}\n\
         #define MOST_COLUMNS {columns}\n#define BUFFER_BYTES {bytes}\n\nstatic const test_case cases[] = {{\n{all}}};\n"
    ))
}

/// The scene of `frames.c`.
struct Scene;

impl ScanlineSource for Scene {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        let shift = |d| if let Frame::View(view) = frame { view.shift(d) } else { (0, 0) };
        let [(near_u, near_v), (far_u, far_v)] = [shift(5), shift(1)];
        for (pixel, u) in line.iter_mut().zip(0..) {
            let near = (u - near_u, v as i32 - near_v);
            let is_box = (20..50).contains(&near.0) && (10..30).contains(&near.1);
            let (x, y) = if is_box { (near.0 + 1000, near.1) } else { (u - far_u, v as i32 - far_v) };
            *pixel = ((x * x * 31 + y * y * 17 + x * y * 7) >> 3) as u8;
        }
        Ok(())
    }
}

/// The builds by CMake, which has cargo build the library: for this machine and for the reference board, in Zephyr's way and in
/// that of the Pico SDK.
fn cmake(folder: &Path) -> Result<()> {
    // Of the reference board, and of the Pico SDK.
    let toolchain = Toolchain::install(&[emulated_board::REFERENCE.target, "thumbv8m.main-none-eabi"])?;
    let cmake = tools::CMAKE.install()?;
    let bare = system::root().join(FOLDER).join("tests/bare/bare.cmake");
    let build = |name: &str, source: &str, processor: Option<&str>, options: &[&str]| -> Result<PathBuf> {
        let built = folder.join(name);
        let mut configure = cmake.command(&["-S", source, "-B"])?;
        configure.arg(&built).arg(format!("-DMULTISCOPIC_FOLDER={}", system::edge_target().display())).args(options);
        let mut build = cmake.command(&["--build"])?;
        build.arg(&built);
        if let Some(processor) = processor {
            configure.arg(format!("-DCMAKE_TOOLCHAIN_FILE={}", bare.display()));
            let pico = system::root().join(FOLDER).join("tests/stubs/pico");
            for command in [&mut configure, &mut build] {
                command.env("PROCESSOR", processor).env("PICO_SDK_PATH", &pico);
            }
        }
        run(&mut configure)?;
        run(toolchain.set_for(&mut build))?;
        Ok(built)
    };
    let host = build("cmake", FOLDER, None, &[])?;
    has_map_of_scene(&read(&mut Command::new(host.join("map")))?)?;
    let m4 = CORTEX_M4.options.join(" ");
    let zephyr = build("zephyr", &format!("{FOLDER}/tests/stubs/zephyr"), Some(&m4), &[])?;
    let exit = emulation::run(&emulated_board::REFERENCE, &zephyr.join("app"), &[], folder, None)?;
    has_map_of_scene(&exit.output)?;
    let m33 = "-mcpu=cortex-m33 -mfloat-abi=softfp -mfpu=fpv5-sp-d16";
    let pico = build("pico", &format!("{FOLDER}/examples/pico"), Some(m33), &[])?;
    ensure!(pico.join("map").is_file(), "the example for the Pico was not linked");
    println!("c: CMake builds the map, as a module of Zephyr and with the Pico SDK too");
    Ok(())
}

/// The build by Meson.
fn meson(toolchain: &Toolchain, folder: &Path) -> Result<()> {
    let (meson, built) = (tools::MESON.install()?, folder.join("meson"));
    let target = format!("-Dfolder={}", system::edge_target().display());
    run(meson.command(&["setup", &target, FOLDER])?.arg(&built))?;
    run(toolchain.set_for(meson.command(&["compile", "-C"])?.arg(&built)))?;
    has_map_of_scene(&read(&mut Command::new(built.join("map")))?)?;
    println!("c: Meson builds the map");
    Ok(())
}

/// The processors that archives are made for: their names in C, the folder of Arduino for their floating point numbers, and the
/// target and processor in Rust.
const ARCHIVES: [(&str, &str, &str, &str); 12] = [
    ("cortex-m0plus", "", "thumbv6m-none-eabi", ""),
    ("cortex-m3", "", "thumbv7m-none-eabi", ""),
    ("cortex-m4", "fpv4-sp-d16-hard", "thumbv7em-none-eabihf", ""),
    ("cortex-m4", "fpv4-sp-d16-softfp", "thumbv7em-none-eabi", ""),
    ("cortex-m7", "fpv5-d16-hard", "thumbv7em-none-eabihf", ""),
    ("cortex-m7", "fpv5-d16-softfp", "thumbv7em-none-eabi", ""),
    ("cortex-m33", "fpv5-sp-d16-hard", "thumbv8m.main-none-eabihf", "cortex-m33"),
    ("cortex-m33", "fpv5-sp-d16-softfp", "thumbv8m.main-none-eabi", "cortex-m33"),
    ("cortex-m55", "auto-hard", "thumbv8m.main-none-eabihf", "cortex-m55"),
    ("cortex-m85", "auto-hard", "thumbv8m.main-none-eabihf", "cortex-m85"),
    ("rv32imac", "", "riscv32imac-unknown-none-elf", ""),
    ("rv32imc", "", "riscv32imc-unknown-none-elf", ""),
];

/// The Arduino library, which has an archive for each of `processors`. Returns its folder.
fn arduino_library(processors: &[(&str, &str, &str, &str)]) -> Result<PathBuf> {
    let (library, source) = (system::target().join("c-library/Multiscopic"), system::root().join(FOLDER));
    if library.exists() {
        fs::remove_dir_all(&library)?;
    }
    for folder in ["examples/Map", "src"] {
        fs::create_dir_all(library.join(folder))?;
    }
    for (from, to) in [
        ("arduino/library.properties", "library.properties"),
        ("arduino/examples/Map/Map.ino", "examples/Map/Map.ino"),
        ("examples/depth.h", "examples/Map/depth.h"),
        ("include/multiscopic.h", "src/multiscopic.h"),
    ] {
        fs::copy(source.join(from), library.join(to)).with_context(|| format!("cannot copy {from}"))?;
    }
    let mut targets: Vec<_> = processors.iter().map(|(_, _, target, _)| *target).collect();
    targets.sort_unstable();
    targets.dedup();
    let toolchain = Toolchain::install(&targets)?;
    for (mcu, abi, target, cpu) in processors {
        let mut cargo = toolchain.cargo("build");
        cargo.args(["--profile", "firmware", "--package", "multiscopic-c", "--target", target]);
        cargo.env("RUSTFLAGS", if cpu.is_empty() { String::new() } else { format!("-Ctarget-cpu={cpu}") });
        run(&mut cargo)?;
        let folder = library.join("src").join(mcu).join(abi);
        fs::create_dir_all(&folder)?;
        fs::copy(system::edge_target().join(target).join("firmware").join(ARCHIVE), folder.join(ARCHIVE))?;
    }
    Ok(library)
}

/// Makes the library for every processor: the header, archives, and what Arduino needs.
pub fn pack() -> Result<()> {
    println!("c: {} has the header and an archive for each processor", arduino_library(&ARCHIVES)?.display());
    Ok(())
}

/// The sketch, with the library as Arduino has it.
fn arduino(folder: &Path) -> Result<()> {
    let [_, _, m4, ..] = ARCHIVES;
    let library = arduino_library(&[m4])?;
    let program = folder.join("sketch");
    let sketch = Target { compiler: tools::ARM_CXX, ..CORTEX_M4 };
    sketch.compile("c++", &["tests/stubs/arduino/sketch.cpp", BOARD], &library.join("examples/Map"), &program)?;
    let exit = emulation::run(&emulated_board::REFERENCE, &program, &[], folder, None)?;
    ensure!(exit.code == 0, "the sketch ended with exit code {}: {}", exit.code, exit.output);
    let (bytes, mut map) = (fs::read(folder.join("frames.packets"))?, String::new());
    for packet in bytes.split(|byte| *byte == 0) {
        let mut packet = packet.to_vec();
        let packet = Packet::decode(&mut packet)?;
        let Content::Line { line, .. } = packet.header.content else { break };
        if line % 8 == 4 {
            let pixels = packet.disparities().skip(2).step_by(4);
            map.extend(pixels.map(|pixel| pixel.map_or(' ', |d| char::from(b'0' + ((d.to_bits() + 32) / 64) as u8))));
            map.push('\n');
        }
    }
    has_map_of_scene(&map)?;
    println!("c: the sketch sends the map");
    Ok(())
}
