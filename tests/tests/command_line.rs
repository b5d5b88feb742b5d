//! The command line as its users meet it: a process, files, messages and exit codes.

use std::{
    fs,
    path::{Path, PathBuf},
};

use multiscopic_tests::{
    command::Run,
    golden::{self, GOLDEN, Golden},
    images::{read_pfm, read_raw16},
    reference::{Fusion, raw16},
};

/// A folder for a test's files, and the arguments of a match in it.
struct Bench {
    dir: tempfile::TempDir,
    arguments: Vec<String>,
}

impl Bench {
    /// A match of the golden centre with these golden neighbours, without an output.
    fn new(views: [bool; 4]) -> Bench {
        let dir = tempfile::tempdir().expect("a folder for the test");
        let options = ["--center", "--left", "--right", "--top", "--bottom"];
        let given = [true, views[0], views[1], views[2], views[3]];
        let mut bench = Bench { dir, arguments: vec!["match".into()] };
        for ((option, path), _) in options.into_iter().zip(golden::paths()).zip(given).filter(|(_, given)| *given) {
            bench.add(option, path);
        }
        bench
    }

    fn stereo() -> Bench {
        Bench::new([false, true, false, false])
    }

    fn add(&mut self, option: &str, value: impl AsRef<Path>) -> &mut Bench {
        self.arguments.extend([option.into(), value.as_ref().to_str().expect("a path in UTF-8").into()]);
        self
    }

    /// Replaces an option's value, or adds it.
    fn set(&mut self, option: &str, value: impl AsRef<Path>) -> &mut Bench {
        if let Some(i) = self.arguments.iter().position(|argument| argument == option) {
            self.arguments.drain(i..i + 2);
        }
        self.add(option, value)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, bytes).expect("a file of the test");
        path
    }

    /// Sends an output to a file of the test's folder.
    fn output(&mut self, option: &str, name: &str) -> PathBuf {
        let path = self.path(name);
        self.set(option, &path);
        path
    }

    fn run(&self) -> Run {
        Run::new(&self.arguments)
    }

    /// The names of the files in the folder, sorted.
    fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.dir.path()).expect("the folder of the test");
        let mut names: Vec<String> =
            entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("a name in UTF-8")).collect();
        names.sort();
        names
    }

    /// Runs with `-o` to a file that does not exist and then to one that does: the message holds `words` both times, and no
    /// file appears or changes.
    #[track_caller]
    fn refused(&mut self, words: &[&str]) {
        self.output("-o", "out.pfm");
        let before = self.files();
        self.run().assert_refused(words);
        assert_eq!(self.files(), before, "no file is left behind");
        let old = self.file("out.pfm", b"what was there");
        let before = self.files();
        self.run().assert_refused(words);
        assert_eq!(self.files(), before, "no file is left behind");
        assert_eq!(fs::read(old).expect("the old file"), b"what was there", "an existing output is untouched");
    }
}

/// What the float reference makes of the golden views.
fn reference(views: [bool; 4], fusion: Fusion, min_disparity: i32, num_disparities: i32, block_size: i32) -> Vec<u16> {
    let images = golden::images().only(views);
    let found = images.reference(fusion, min_disparity, num_disparities, block_size).disparities();
    found.into_iter().map(raw16).collect()
}

fn name(fusion: Fusion) -> &'static str {
    match fusion {
        Fusion::Min => "min",
        Fusion::Mean => "mean",
        Fusion::Heuristic => "heuristic",
    }
}

#[test]
fn without_arguments_it_helps() {
    let run = Run::new::<&str>([]);
    let help = format!("{}{}", run.stdout, run.stderr);
    for command in ["match", "evaluate", "demo", "bench"] {
        assert!(help.contains(command), "the help names `{command}`: {run:#?}");
    }
    assert_eq!(run.code, Some(0), "{run:#?}");
}

#[test]
fn help_names_the_spellings_of_opencv_and_ros() {
    let run = Run::new(["match", "--help"]);
    assert_eq!((run.code, run.stderr.as_str()), (Some(0), ""), "{run:#?}");
    let words = ["minDisparity", "numDisparities", "blockSize", "disparity_range", "correlation_window_size", "--raw16", "--ply"];
    for word in words {
        assert!(run.stdout.contains(word), "the help names `{word}`: {}", run.stdout);
    }
}

#[test]
fn results_are_those_of_the_float_reference() {
    for Golden { name: golden, views, fusion, min_disparity, num_disparities, block_size } in GOLDEN {
        let mut bench = Bench::new(views);
        let pfm = bench.output("-o", "out.pfm");
        let raw = bench.output("--raw16", "raw.png");
        bench.add("--fusion", name(fusion)).add("--min-disparity", min_disparity.to_string());
        bench.add("--num-disparities", num_disparities.to_string()).add("--block-size", block_size.to_string());
        bench.run().assert_done();
        assert_eq!(bench.files(), ["out.pfm", "raw.png"]);

        let (width, height, expected) = read_raw16(&golden::folder().join(format!("{golden}.raw16.png")));
        assert_eq!(read_raw16(&raw), (width, height, expected.clone()), "{golden}");
        let pixels = |raw| if raw == 0 { f32::INFINITY } else { (f32::from(raw) - 32768.0) / 64.0 };
        assert_eq!(read_pfm(&pfm), (width, height, expected.into_iter().map(pixels).collect()), "{golden}");
    }
}

#[test]
fn any_set_of_neighbours_and_the_defaults() {
    for views in 1..16_u8 {
        let views = [0, 1, 2, 3].map(|i| views >> i & 1 != 0);
        let fusion = if views.into_iter().filter(|&view| view).count() <= 2 { Fusion::Min } else { Fusion::Heuristic };
        let mut bench = Bench::new(views);
        bench.output("-o", "out.pfm");
        let raw = bench.output("--raw16", "raw.png");
        bench.run().assert_done();
        assert_eq!(read_raw16(&raw).2, reference(views, fusion, 1, 60, 11), "{views:?}");
    }
}

#[test]
fn other_kinds_of_images() {
    let (width, height) = (golden::WIDTH, golden::HEIGHT);
    let mut bench = Bench::stereo();
    bench.output("-o", "out.pfm");
    let raw = bench.output("--raw16", "raw.png");
    let images = golden::images();

    let mut pgm = format!("P5\n{width} {height}\n255\n").into_bytes();
    pgm.extend(&images.center);
    let pgm = bench.file("center.pgm", &pgm);
    bench.set("--center", pgm);
    // Grey is (77 R + 150 G + 29 B + 128) >> 8: colours whose grey is not their mean.
    let mut ppm = format!("P6\n{width} {height}\n255\n").into_bytes();
    let right = images.views[1].as_ref().expect("the right view");
    let colours: Vec<[u8; 3]> =
        right.iter().zip((0..=255_u8).cycle()).map(|(&grey, i)| [grey, grey ^ i.wrapping_mul(37), 255 - grey]).collect();
    ppm.extend(colours.iter().flatten());
    let ppm = bench.file("right.ppm", &ppm);
    bench.set("--right", ppm);
    bench.add("--num-disparities", "9");
    bench.run().assert_done();

    let grey = |&[r, g, b]: &[u8; 3]| ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b) + 128) >> 8) as u8;
    let grey: Vec<u8> = colours.iter().map(grey).collect();
    let mut pair = images.only([false, true, false, false]);
    pair.views[1] = Some(grey);
    let expected: Vec<u16> = pair.reference(Fusion::Min, 1, 9, 11).disparities().into_iter().map(raw16).collect();
    assert_eq!(read_raw16(&raw).2, expected);
}

#[test]
fn a_frame_of_one_pixel() {
    let mut bench = Bench::stereo();
    let pixel = bench.file("pixel.pgm", b"P5 1 1 255\n\x07");
    bench.set("--center", &pixel).set("--right", &pixel);
    bench.output("-o", "out.pfm");
    let raw = bench.output("--raw16", "raw.png");
    bench.run().assert_done();
    assert_eq!(read_raw16(&raw), (1, 1, vec![0]), "no candidate from disparity 1 on");
    bench.add("--min-disparity", "0").add("--num-disparities", "1");
    bench.run().assert_done();
    assert_eq!(read_raw16(&raw), (1, 1, vec![32768]), "disparity 0");
}

/// The colours go from Turbo's first at the far end to its last at the near one; invalid is black.
#[test]
fn the_picture_is_turbo() {
    let mut bench = Bench::new([false, false, true, false]);
    bench.output("-o", "out.pfm");
    let raw = bench.output("--raw16", "raw.png");
    let png = bench.output("--png", "picture.png");
    bench.add("--num-disparities", "8");
    bench.run().assert_done();
    let picture = image::open(png).expect("a picture").to_rgb8();
    assert_eq!(picture.dimensions(), (48, 32));
    let colours: Vec<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
    let raw = read_raw16(&raw).2;
    assert!(raw.contains(&0), "some pixels are invalid");
    for (&raw, &colour) in raw.iter().zip(&colours) {
        assert_eq!(raw == 0, colour == [0, 0, 0], "{raw} is drawn as {colour:?}");
    }
    let valid = || raw.iter().zip(&colours).filter(|(raw, _)| **raw != 0);
    let nearest = valid().max_by_key(|(raw, _)| **raw).expect("a valid pixel").1;
    let furthest = valid().min_by_key(|(raw, _)| **raw).expect("a valid pixel").1;
    // Of the table that Google Research published. Its usual polynomial, which may be drawn with, is a little off.
    for (colour, turbo) in [(furthest, [48_u8, 18, 59]), (nearest, [122, 4, 3])] {
        let off = colour.iter().zip(turbo).map(|(a, b)| a.abs_diff(b)).max().expect("three channels");
        assert!(off <= 25, "{colour:?} is drawn for {turbo:?}");
    }
}

#[test]
fn an_output_is_replaced_as_a_whole() {
    let mut bench = Bench::stereo();
    let pfm = bench.output("-o", "out.pfm");
    bench.file("out.pfm", &[b'x'; 100_000]);
    bench.run().assert_done();
    assert_eq!(read_pfm(&pfm).2.len(), 48 * 32);
    assert_eq!(bench.files(), ["out.pfm"]);
}

#[test]
fn a_file_that_is_not_there() {
    for option in ["--center", "--right"] {
        let mut bench = Bench::stereo();
        let missing = bench.path("missing.png");
        bench.set(option, missing).refused(&["missing.png"]);
    }
}

#[test]
fn a_folder_instead_of_an_image() {
    let mut bench = Bench::stereo();
    let folder = bench.path("folder.png");
    fs::create_dir(&folder).expect("a folder");
    bench.set("--right", folder).refused(&["folder.png"]);
}

#[test]
fn images_of_different_sizes() {
    let mut bench = Bench::stereo();
    let small = bench.file("small.pgm", &[b"P5 47 32 255\n", &[0; 47 * 32][..]].concat());
    bench.set("--right", small).refused(&["small.pgm", "47x32", "48x32"]);
}

#[test]
fn broken_images() {
    let png = fs::read(&golden::paths()[0]).expect("a golden image");
    // A PNG's header: signature, length, `IHDR`, width, height, five bytes, checksum.
    let with_size = |width: u32, height: u32| {
        let mut png = png.clone();
        png[16..20].copy_from_slice(&width.to_be_bytes());
        png[20..24].copy_from_slice(&height.to_be_bytes());
        let checksum = crc32(&png[12..29]);
        png[29..33].copy_from_slice(&checksum.to_be_bytes());
        png
    };
    assert_eq!(with_size(48, 32), png, "a golden image is laid out as this test supposes");
    let mut wrong_data = png.clone();
    let middle = png.len() / 2;
    wrong_data[middle..middle + 50].fill(0x5A);

    let cases: [(&str, Vec<u8>); 14] = [
        ("empty.png", Vec::new()),
        ("text.png", b"this is not an image\n".to_vec()),
        ("signature.png", png[..8].to_vec()),
        ("truncated.png", png[..png.len() / 2].to_vec()),
        ("no-end.png", png[..png.len() - 30].to_vec()),
        ("wrong-data.png", wrong_data),
        ("no-columns.png", with_size(0, 32)),
        ("no-lines.png", with_size(48, 0)),
        ("huge.png", with_size(0x7FFF_FFFF, 0x7FFF_FFFF)),
        ("zero.pgm", b"P5\n0 0\n255\n".to_vec()),
        ("huge.pgm", b"P5\n4294967295 4294967295\n255\n".to_vec()),
        ("overflow.pgm", b"P5\n99999999999999999999 1\n255\n\0".to_vec()),
        ("short.pgm", [b"P5\n48 32\n255\n", &[7; 48 * 32 - 1][..]].concat()),
        ("huge.pfm", b"Pf\n65000 65000\n-1\n".to_vec()),
    ];
    for (name, bytes) in cases {
        for option in ["--center", "--right"] {
            let mut bench = Bench::stereo();
            let path = bench.file(name, &bytes);
            bench.set(option, path).refused(&[name]);
        }
    }
}

/// The checksum of a PNG's chunk.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc: u32, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

#[test]
fn no_neighbour() {
    Bench::new([false; 4]).refused(&["neighbo"]);
}

#[test]
fn no_centre() {
    let mut bench = Bench::stereo();
    bench.arguments.drain(1..3);
    bench.refused(&["--center", "RIG_DIR"]);
}

#[test]
fn no_output() {
    let bench = Bench::stereo();
    bench.run().assert_refused(&["-o"]);
}

#[test]
fn parameters_out_of_range() {
    let cases: [(&[&str], &[&str]); 13] = [
        (&["--block-size", "4"], &["4", "odd"]),
        (&["--block-size", "0"], &["0"]),
        (&["--block-size", "23"], &["23", "21"]),
        (&["--block-size", "300"], &["300"]),
        (&["--block-size", "-3"], &["-3"]),
        (&["--block-size", "eleven"], &["eleven"]),
        (&["--num-disparities", "0"], &["0"]),
        (&["--num-disparities", "-16"], &["-16"]),
        (&["--num-disparities", "512"], &["512", "511"]),
        (&["--min-disparity", "-512"], &["-512", "-511"]),
        (&["--min-disparity", "500", "--num-disparities", "13"], &["512", "511"]),
        (&["--min-disparity", "99999"], &["99999"]),
        (&["--fusion", "median"], &["median", "heuristic"]),
    ];
    for (arguments, words) in cases {
        let mut bench = Bench::stereo();
        bench.arguments.extend(arguments.iter().map(|&argument| argument.into()));
        bench.refused(words);
    }
}

#[test]
fn unknown_options_and_commands() {
    let mut bench = Bench::stereo();
    bench.arguments.push("--blocksize".into());
    bench.refused(&["--blocksize"]);
    Run::new(["macth"]).assert_refused(&["macth"]);
}

#[test]
fn outputs_that_cannot_be_written() {
    for option in ["-o", "--png", "--raw16"] {
        let mut bench = Bench::stereo();
        bench.output("-o", "out.pfm");
        let name = if option == "-o" { "nowhere/x.pfm" } else { "nowhere/x.png" };
        let path = bench.output(option, name);
        bench.run().assert_refused(&[path.to_str().expect("UTF-8")]);
        assert_eq!(bench.files(), [""; 0], "{option}: nothing is left behind");

        // A folder is in the way.
        let folder = bench.path("folder");
        fs::create_dir(&folder).expect("a folder");
        bench.set(option, &folder);
        bench.run().assert_refused(&[folder.to_str().expect("UTF-8")]);
        assert_eq!(bench.files(), ["folder"], "{option}: nothing is left behind");
    }
}
