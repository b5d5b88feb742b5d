//! Whatever bytes come from outside, readers return: no panic, no endless work, no more memory than the limits allow.
//!
//! Valid files are damaged at random. `PROPTEST_CASES=100000` tries so many of them with each reader, instead of a few.

#![cfg(unix)]

use std::{
    env,
    fmt::Debug,
    fs, io,
    path::Path,
    time::{Duration, Instant, UNIX_EPOCH},
};

use image::{DynamicImage, ImageFormat, Luma, Rgb};
use multiscopic::{
    CameraModel, Picture, Result, Rig,
    capture::Imperfections,
    files::{FrameFiles, FramePose, Limits, ListedRig},
    images::Transform,
    lens::Mount,
    target::reception,
};
use multiscopic_core::{Disparity, Fusion, Region, SearchConfig, Views};
use multiscopic_edge::packet::{Sender, buffer_bytes_with_confidences};
use multiscopic_reference::split_mix::Random;
use multiscopic_tests::{program, test_images::golden};
use proptest::{collection::vec, prelude::*, sample::Index, test_runner::TestRunner};

/// The address space in megabytes in which everything must be read. The largest picture takes half of it.
const MEMORY: usize = 2048;
/// The time after which a reader counts as hung.
const LONGEST: Duration = Duration::from_secs(120);
/// The number of files for each reader, unless `PROPTEST_CASES` says otherwise.
const CASES: u32 = 500;

/// A change of a file.
#[derive(Clone, Debug)]
enum Damage {
    Flip(Index, u8),
    Set(Index, u8),
    /// Sets a byte among the first 64, which matter most.
    SetInHeader(Index, u8),
    Cut(Index, Index),
    Repeat(Index, Index),
    Insert(Index, Vec<u8>),
    End(Index),
}

impl Damage {
    fn any() -> impl Strategy<Value = Damage> {
        let at = any::<Index>;
        prop_oneof![
            4 => (at(), 0..8_u8).prop_map(|(at, bit)| Damage::Flip(at, bit)),
            2 => (at(), any::<u8>()).prop_map(|(at, byte)| Damage::Set(at, byte)),
            4 => (at(), any::<u8>()).prop_map(|(at, byte)| Damage::SetInHeader(at, byte)),
            1 => (at(), at()).prop_map(|(from, to)| Damage::Cut(from, to)),
            1 => (at(), at()).prop_map(|(from, to)| Damage::Repeat(from, to)),
            1 => (at(), vec(any::<u8>(), 1..40)).prop_map(|(at, bytes)| Damage::Insert(at, bytes)),
            1 => at().prop_map(Damage::End),
        ]
    }

    fn apply(&self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        let len = bytes.len();
        let between = |from: &Index, to: &Index| {
            let [from, to] = [from.index(len), to.index(len)];
            from.min(to)..from.max(to)
        };
        match self {
            Damage::Flip(at, bit) => bytes[at.index(len)] ^= 1 << bit,
            Damage::Set(at, byte) => bytes[at.index(len)] = *byte,
            Damage::SetInHeader(at, byte) => bytes[at.index(len.min(64))] = *byte,
            Damage::Cut(from, to) => drop(bytes.drain(between(from, to))),
            Damage::Repeat(from, to) => bytes.extend_from_within(between(from, to)),
            Damage::Insert(at, inserted) => drop(bytes.splice(at.index(len)..at.index(len), inserted.iter().copied())),
            Damage::End(at) => bytes.truncate(at.index(len)),
        }
    }
}

/// Gives `read` damaged versions of valid files, within limits of memory and time. `name` is the test's.
fn survive(name: &str, valid: &[Vec<u8>], repair: impl Fn(&mut [u8]), read: impl Fn(&Path)) {
    const INSIDE: &str = "MULTISCOPIC_MEMORY_IS_LIMITED";
    if env::var_os(INSIDE).is_none() {
        let mut test = program::within(MEMORY, &env::current_exe().expect("this test"));
        let output = test.args(["--exact", name, "--test-threads", "1"]).env(INSIDE, "1").output().expect("the test runs");
        assert!(
            output.status.success(),
            "{}{}",
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        );
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("file");
    let mut config = ProptestConfig::default();
    if env::var_os("PROPTEST_CASES").is_none() {
        config.cases = CASES;
    }
    let damaged = (0..valid.len(), vec(Damage::any(), 0..4), any::<bool>());
    let tried = TestRunner::new(config).run(&damaged, |(which, damage, is_repaired)| {
        let mut bytes = valid[which].clone();
        damage.iter().for_each(|damage| damage.apply(&mut bytes));
        if is_repaired {
            repair(&mut bytes);
        }
        fs::write(&path, &bytes).expect("a file");
        let start = Instant::now();
        read(&path);
        prop_assert!(start.elapsed() < LONGEST, "{:?}", start.elapsed());
        Ok(())
    });
    tried.unwrap_or_else(|error| panic!("{error}"));
}

fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = io::Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, format).expect("an image");
    bytes.into_inner()
}

/// Makes the checksums of a PNG's chunks right again, so that what they protect is read.
fn with_checksums(bytes: &mut [u8]) {
    let mut start = 8;
    while let Some(length) = bytes.get(start..start + 4).and_then(|length| length.first_chunk()) {
        let end = start + 8 + u32::from_be_bytes(*length) as usize;
        let Some(chunk) = bytes.get(start + 4..end) else { return };
        let checksum = crc32fast::hash(chunk);
        match bytes.get_mut(end..end + 4) {
            Some(place) => place.copy_from_slice(&checksum.to_be_bytes()),
            None => return,
        }
        start = end + 4;
    }
}

/// Photos with every kind of scan, and their names.
fn jpegs() -> [(&'static str, Vec<u8>); 4] {
    ["baseline", "progressive", "restarts", "gray-progressive"].map(|name| {
        let path = golden::folder().join(format!("jpeg/{name}.jpg"));
        (name, fs::read(path).expect("a golden file"))
    })
}

#[test]
fn pictures() {
    let gray = image::GrayImage::from_fn(31, 17, |u, v| Luma([(u * v) as u8]));
    let deep = image::ImageBuffer::from_fn(13, 9, |u, v| Luma([(700 * u * v) as u16]));
    let color = image::RgbImage::from_fn(23, 19, |u, v| Rgb([(9 * u) as u8, (11 * v) as u8, (u * v) as u8]));
    let pfm = [b"Pf\n3 2\n-1.0\n".to_vec(), [0.5_f32, 0.25, 1.0, 0.0, 0.125, 0.75].map(f32::to_le_bytes).concat()].concat();
    // Pillow made it, of 4 x 4 pixels in 6 colours.
    let palette = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x04\0\0\0\x04\x04\x03\0\0\0[\xdf\x83M\0\0\0\x12PLTE\xb4\xe7x\xc3\xbcSH\xe0yB\x9fe]p\x80=\
                    5t\xe9\xaf\xeee\0\0\0\x14IDATx\xdac\x14Rbr\xe0af\x7f\xcb\xcc\xfd\x11\0\t\x91\x02z\xf4\xf0\xee\xf8\0\0\0\0IEND\xaeB`\x82";
    let others = [
        palette.to_vec(),
        encoded(gray.clone(), ImageFormat::Png),
        encoded(deep.clone(), ImageFormat::Png),
        encoded(color.clone(), ImageFormat::Png),
        encoded(gray, ImageFormat::Pnm),
        encoded(deep, ImageFormat::Pnm),
        encoded(color, ImageFormat::Pnm),
        b"P2 3 2 9\n1 2 3\n4 5 6\n".to_vec(),
        b"P1 3 2\n1 0 1\n0 1 0\n".to_vec(),
        pfm,
    ];
    survive("pictures", &[&others[..], &jpegs().map(|(_, jpeg)| jpeg)].concat(), with_checksums, |path| {
        let _ = Picture::read(path);
        let _ = Picture::brightest(&[path], Limits::DEFAULT);
        let _ = multiscopic::files::read_pfm(path);
        let _ = multiscopic::files::read_disparities(path, None, Limits::DEFAULT);
    });
}

/// Tells whether bytes are read as a picture, each time from the same file.
fn picture_reader() -> impl Fn(&[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a folder");
    move |bytes| {
        let path = folder.path().join("photo.jpg");
        fs::write(&path, bytes).expect("a file");
        Picture::read(&path).is_ok()
    }
}

#[test]
fn restarts_of_a_jpeg_out_of_order_are_an_error() {
    let is_read = picture_reader();
    let [_, _, (_, whole), _] = jpegs();
    let restarts: Vec<usize> = (0..whole.len() - 1).filter(|&at| matches!(whole[at..], [0xFF, 0xD0..=0xD7, ..])).collect();
    assert!(restarts.len() >= 8, "{restarts:?}");
    for at in restarts {
        let mut changed = whole.clone();
        changed[at + 1] ^= 1;
        assert!(!is_read(&changed), "the marker at {at}");
    }
}

/// Cameras leave out tables and the end, and add bytes. Other decoders read what they write, and so does this one.
#[test]
fn whole_jpegs_of_cameras_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let read = |bytes: &[u8]| {
        let path = folder.path().join("photo.jpg");
        fs::write(&path, bytes).expect("a file");
        Picture::read(&path)
    };
    for (name, whole) in jpegs() {
        let expected = read(&whole).expect("a photo");
        let data = &whole[..whole.len() - 2];
        for trailer in [&b""[..], &[0; 300], b"\xFF", b"a trailer"] {
            assert_eq!(read(&[data, trailer].concat()).ok(), Some(expected.clone()), "{name} without its end, {trailer:?}");
        }
        assert!(read(&whole[..whole.len() - 20]).is_err(), "{name}: its data are missing");
        for surplus in [1, 9, 200] {
            let is_restart = |at: usize| matches!(whole[at..], [0xFF, 0xD0..=0xD7, ..]);
            let bytes = |at: usize| [vec![0x5A; if is_restart(at) { surplus } else { 0 }], vec![whole[at]]].concat();
            let padded: Vec<u8> = (0..whole.len()).flat_map(bytes).collect();
            assert_eq!(read(&padded).ok(), Some(expected.clone()), "{name} with {surplus} bytes before its restarts");
        }
    }
}

#[test]
fn damage_inside_a_jpeg_is_an_error() {
    let is_read = picture_reader();
    let mut random = Random(7);
    for (name, whole) in jpegs() {
        assert!(is_read(&whole), "{name}");
        // Bytes that some cameras add before the end.
        let (data, end) = whole.split_at(whole.len() - 2);
        assert!(is_read(&[data, &[0; 6], end].concat()), "{name}");
        assert!(!is_read(&[data, &[0; 20], end].concat()), "{name}");
        let start = whole.windows(2).position(|marker| marker == [0xFF, 0xDA]).expect("a scan") + 14;
        let mut refused = [0; 3];
        for _ in 0..100 {
            let at = start + random.below(whole.len() - start - 34);
            let mut damaged = [(); 3].map(|()| whole.clone());
            damaged[0][at..at + 32].fill_with(|| random.byte());
            damaged[1][at..at + 32].fill(0);
            damaged[2].drain(at..at + 32);
            for (refused, damaged) in refused.iter_mut().zip(damaged) {
                *refused += usize::from(!is_read(&damaged));
            }
        }
        // Damage that keeps the decoder in step cannot be noticed.
        assert!(refused.iter().all(|refused| *refused >= 70), "{name}: {refused:?} of 100 are refused");
    }
}

/// Reads a file, and returns its contents in the words of the library.
type Reader = fn(&Path) -> Result<String>;

fn in_words(value: Result<impl Debug>) -> Result<String> {
    value.map(|value| format!("{value:?}"))
}

/// Reads a file as the `rig.toml` of its folder.
fn read_rig(path: &Path) -> Result<String> {
    let folder = path.parent().expect("a folder");
    if !path.ends_with(Rig::FILE_NAME) {
        fs::copy(path, folder.join(Rig::FILE_NAME)).expect("a copy");
    }
    in_words(Rig::load(folder))
}

const CALIBRATION: Reader = |path| in_words(CameraModel::read(path));

/// Texts of every kind that a user writes or brings, by the names of their files, and their readers.
fn texts() -> Vec<(&'static str, Vec<u8>, Reader)> {
    let pose = FramePose {
        asked_mm: [0.0, 0.0],
        counted_mm: Some([0.01, -0.02]),
        exposed: Some(UNIX_EPOCH + Duration::from_millis(1_773_480_413_589)),
        measured: Some(Transform { translation_mm: [400.0, -200.5, 500.0], rotation_deg: [180.0, 0.0, 0.25] }),
    };
    let rig = Rig {
        baseline_mm: Some(20.0),
        focal_px: Some(480.5),
        principal_point: Some([159.5, 119.5]),
        doffs: 0.25,
        lens: None,
        mount_rotation_deg: Some([0.5, -1.0, 2.0]),
        mount_roll_deg: Some(1.5),
        sweep: Vec::new(),
        hand_eye: None,
        poses: [("center".to_owned(), pose)].into(),
        images: FrameFiles::of_capture(Views::CROSS),
        alignment: None,
        capture: Default::default(),
    };
    let folder = tempfile::tempdir().expect("a folder");
    rig.save(folder.path()).expect("a rig.toml");
    let rig = fs::read(folder.path().join(Rig::FILE_NAME)).expect("a rig.toml");
    let texts: [(_, &[u8], Reader); 9] = [
        (Rig::FILE_NAME, &rig, read_rig),
        ("camera.toml", b"size = [640, 480]\nfocal_px = [470.0, 470.0]\nprincipal_point = [162.0, 117.5]\nmodel = \"plumb_bob\"\n\
          coefficients = [-0.25, 0.08, 0.0, 0.0, 0.0]\n", CALIBRATION),
        ("ros.yaml", b"image_width: 640\nimage_height: 480\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [535.9, 0., 342.2, 0., 536.5, 235.5, 0., 0., 1.]\n\
          distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.2, -0.03, 0.001, -0.0002, 0.2]\n", CALIBRATION),
        ("ost.txt", b"[image]\n\nwidth\n640\n\nheight\n480\n\n[camera]\n\ncamera matrix\n535.9 0.0 342.2\n0.0 536.5 235.5\n0.0 0.0 1.0\n\n\
          distortion\n-0.2 -0.03 0.001 -0.0002 0.2\n\nrectification\n1 0 0\n0 1 0\n0 0 1\n\n\
          projection\n535.9 0.0 342.2 0.0\n0.0 536.5 235.5 0.0\n0.0 0.0 1.0 0.0\n", CALIBRATION),
        ("lens.json", b"{\"K\": [[535.9, 0, 342.2], [0, 536.5, 235.5], [0, 0, 1]],\n\"dist\": [-0.2, -0.03, 0.001, -0.0002, 0.2],\n\
          \"image_size\": [640, 480]}\n", CALIBRATION),
        ("kalibr.yaml", b"cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.013, 0.021, -0.018, 0.004]\n  distortion_model: equidistant\n  \
          intrinsics: [380.8, 380.9, 511.4, 513.6]\n  resolution: [1024, 1024]\n", CALIBRATION),
        ("mount.toml", b"rotation_deg = [1.5, -2.0, 2.5]\n", |path| in_words(Mount::read(path))),
        ("rig-errors.toml", b"[mount]\nrotation_deg = [0.5, -1.0, 2.0]\n[stage]\nscale = [1.01, 1.0]\nbacklash_mm = 0.05\nstalls_at_move = 6\n",
            |path| in_words(Imperfections::read(path))),
        ("list.txt", b"# Two shelves\n\nshelf/1\nshelf/2\n", |path| in_words(ListedRig::read_all(path))),
    ];
    texts.map(|(name, text, read)| (name, text.to_vec(), read)).into()
}

/// Checks that a message is short.
fn check_message(message: &str) {
    let count = message.chars().count();
    assert!(count <= 1000, "a message of {count} characters: {message:.200}");
}

#[test]
fn settings() {
    let (valid, readers): (Vec<_>, Vec<_>) = texts().into_iter().map(|(_, text, read)| (text, read)).unzip();
    survive(
        "settings",
        &valid,
        |_| (),
        |path| readers.iter().for_each(|read| drop(read(path).inspect_err(|error| check_message(&error.to_string())))),
    );
}

/// Editors of Windows write a byte order mark, and CR LF.
#[test]
fn texts_of_other_editors_say_the_same() {
    for (name, text, read) in texts() {
        let read = |text: &str| {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join(name);
            fs::write(&path, text).expect("a file");
            let words = read(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
            words.replace(folder.path().to_str().expect("a path"), "")
        };
        let text = String::from_utf8(text).expect("a text");
        let expected = read(&text);
        for other in [format!("\u{feff}{text}"), text.replace('\n', "\r\n"), format!("\u{feff}{}", text.replace('\n', "\r\n"))] {
            assert_eq!(read(&other), expected, "{name}");
        }
    }
}

/// Files of one kind where another is expected, with a line that is too long for any message.
#[test]
fn other_files_are_named_in_short() {
    let long = ["x = 1 ", "1 2 3\n", "a: b: c ", "\u{1}\u{1b}[2J", "[", "\u{e9}"].map(|part| part.repeat(60_000));
    let folder = tempfile::tempdir().expect("a folder");
    for (name, _, read) in texts() {
        let path = folder.path().join(name);
        for bytes in long.iter().map(|text| text.as_bytes()).chain([&b"\x89PNG\r\n\x1a\n"[..], &[0; 5000], &[0xFF; 5000]]) {
            fs::write(&path, bytes).expect("a file");
            if let Err(error) = read(&path) {
                let message = error.to_string();
                check_message(&message);
                assert!(!message.contains("damaged"), "{message}");
            }
        }
    }
}

/// Parsers that recurse would overflow their stacks, and end the program.
#[test]
fn deeply_nested_texts_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    for (open, close) in [("- ", ""), ("? ", ""), ("[", "]"), ("{a: ", "}"), ("- [", "]"), ("- a:\n", "")] {
        for depth in [101, 100_000] {
            let text = match open.strip_suffix('\n') {
                // A line for each level, as far as a text may be long.
                Some(line) => (0..depth.min(1000)).map(|level| format!("{:1$}{line}\n", "", 4 * level)).collect(),
                None => open.repeat(depth) + &close.repeat(depth),
            };
            fs::write(path("deep.yaml"), text).expect("a file");
            let error = CameraModel::read(&path("deep.yaml")).expect_err("it is no calibration").to_string();
            assert!(error.contains("levels of YAML") || error.contains("is not YAML"), "{open:?}, {depth} levels: {error}");
        }
    }
    for text in
        ["a = ".to_owned() + &"[".repeat(100_000), "a.".repeat(100_000) + "b = 1", "a = ".to_owned() + &"{b = ".repeat(100_000)]
    {
        fs::write(path(Rig::FILE_NAME), text).expect("a file");
        assert!(Rig::load(folder.path()).is_err());
    }
}

/// Random words of the command line, the last of which is always wrong, so that nothing runs: whatever the others are, it is
/// refused.
#[test]
fn command_lines_are_refused_without_a_panic() {
    const WORDS: [&str; 46] = [
        "match",
        "evaluate",
        "demo",
        "align",
        "capture",
        "calibrate",
        "lens",
        "mount",
        "rig",
        "scene",
        "bench",
        "budget",
        "simulate",
        "view",
        "listen",
        "--center",
        "--view",
        "1,-1=a.png",
        "--num-disparities",
        "--min-disparity",
        "--block-size",
        "--stage",
        "ur10:[::1]:0,99999",
        "gcode:@",
        "--camera",
        "sim:",
        "--size",
        "0x0",
        "99999999999x1",
        "--region",
        "1x1+-1+-1",
        "--layout",
        "3x",
        "--accuracy",
        "1mm@0m",
        "--until",
        "1e999 % within -1 mm",
        "--views",
        "4,4,4",
        "--baseline",
        "-1e999",
        "nan",
        "--shard",
        "0/0",
        "",
        "\u{fffd}=\u{0}",
    ];
    let mut random = Random(u64::from(std::process::id()));
    for _ in 0..150 {
        let words: Vec<&str> = (0..1 + random.below(6)).map(|_| WORDS[random.below(WORDS.len())]).collect();
        // The system takes no zeros.
        let words = words.iter().map(|word| word.replace('\0', "\u{1}")).chain(["--no-such-option".into()]);
        let words: Vec<String> = words.collect();
        let run = program::Invocation::new(&words);
        assert!(run.code == Some(2) && !run.stderr.contains("panicked"), "{words:?}: {run:?}");
    }
}

#[test]
fn packets() {
    let valid = [([7_u16, 5_u16], 4), ([3000, 2], 3000), ([9000, 7000], 1)].map(|([width, height], columns)| {
        let params = SearchConfig {
            views: Views::HORIZONTAL,
            fusion: Fusion::Min,
            num_disparities: 8,
            ..SearchConfig::of_size(width, height)
        }
        .block_matching(3)
        .expect("parameters in range");
        let mut buffer = vec![0; buffer_bytes_with_confidences(columns)];
        let mut sender = Sender::new(params.search(), &mut buffer);
        let mut packets = Vec::new();
        for tile in Region::tiles(params.search(), columns).take(3) {
            let line = vec![Disparity::from_bits(128); tile.width()];
            for v in 0..usize::from(height.min(5)) {
                let confidences = vec![200; tile.width()];
                packets.extend(sender.line(&tile, v, &line).expect("the buffer is for it"));
                packets.extend(sender.line_with_confidences(&tile, v, &line, &confidences).expect("the buffer is for it"));
            }
        }
        packets.extend(sender.end(Some(3000)).expect("the buffer is for it"));
        packets
    });
    survive(
        "packets",
        &valid,
        |_| (),
        |path| {
            let _ = reception::receive(&fs::read(path).expect("a file")[..], path, Limits::DEFAULT, |_| ());
        },
    );
}
