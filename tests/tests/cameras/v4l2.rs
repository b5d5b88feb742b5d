//! Cameras of Linux's own drivers, with every fault that these can inject.

use std::{
    collections::BTreeSet,
    error::Error,
    io::ErrorKind,
    num::NonZeroU16,
    os::unix::process::CommandExt,
    path::Path,
    process::Command,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

use image::{GrayImage, Luma, codecs::jpeg::JpegEncoder};
use libtest_mimic::Trial;
use multiscopic::{
    Picture,
    capture::camera::{CameraFault, CameraSettings, FrameLayout, PixelFormat, V4l2Camera},
};
use multiscopic_reference::split_mix::Random;
use multiscopic_tests::{
    program,
    simulated::cameras::{self, Pattern, Producer},
    test_images::golden,
};
use v4l::{Control, Device, control::Value, video::Capture};

type Outcome = Result<(), Box<dyn Error>>;

/// Cameras with patterns and faults.
const VIVID: [&str; 2] = ["/dev/video0", "/dev/video1"];
/// A camera with the multi-planar interface only, as the camera ports of many boards have it.
const MULTIPLANAR: &str = "/dev/video2";
/// Loopback devices.
const LOOPBACK: [&str; 5] = ["/dev/video10", "/dev/video11", "/dev/video12", "/dev/video13", "/dev/video14"];

/// The time-out of captures that must fail.
const SHORT: Duration = Duration::from_millis(1500);
/// The time-out of captures that must succeed in an emulator. Only a hung capture reaches it.
const LONG: Duration = Duration::from_secs(120);

/// The bars' luma in full range, by ITU-R BT.709.
const FULL: [u8; 8] = [254, 235, 200, 181, 72, 54, 18, 0];
/// The bars' luma in limited range, 16 to 235, by ITU-R BT.601.
const LIMITED: [u8; 8] = [234, 209, 168, 144, 106, 81, 40, 16];
/// The grey of the bars' colours, by the rule for image files.
const COLORS: [u8; 8] = [255, 226, 178, 149, 106, 77, 29, 0];

/// The bars' grey follows the standards, except for the driver's rounding.
fn bars_are_known() -> Outcome {
    for (i, color) in [0b111, 0b110, 0b011, 0b010, 0b101, 0b100, 0b001, 0b000].into_iter().enumerate() {
        let [red, green, blue] = [2, 1, 0].map(|bit| f64::from(color >> bit & 1));
        let luma = |weights: [f64; 3]| weights[0] * red + weights[1] * green + weights[2] * blue;
        let full = 255.0 * luma([0.2126, 0.7152, 0.0722]);
        let limited = 16.0 + 219.0 * luma([0.299, 0.587, 0.114]);
        let colors = (luma([77.0, 150.0, 29.0]) * 255.0 + 128.0) / 256.0;
        let is_near = |found: u8, exact: f64| (-2.0..=0.5).contains(&(f64::from(found) - exact));
        if !is_near(FULL[i], full) || !is_near(LIMITED[i], limited) || f64::from(COLORS[i]) != colors.floor() {
            return Err(format!("bar {i}: {full}, {limited}, {colors}").into());
        }
    }
    Ok(())
}

/// Settings for quick, small captures.
fn quick() -> CameraSettings {
    CameraSettings {
        format: Some(PixelFormat::Grey),
        size: Some([320, 180]),
        warm_up: 1,
        lock: false,
        ..CameraSettings::default()
    }
}

fn open(device: &str, settings: &CameraSettings) -> Result<V4l2Camera, multiscopic::capture::camera::CameraError> {
    V4l2Camera::open(Path::new(device), settings)
}

fn frame(camera: &mut V4l2Camera) -> Result<GrayImage, multiscopic::capture::camera::CameraError> {
    camera.frame(LONG, &AtomicBool::new(false)).map(|picture| picture.to_gray())
}

/// An image of the bars.
fn bars([width, height]: [u32; 2], grays: &[u8; 8]) -> GrayImage {
    GrayImage::from_fn(width, height, |u, _| Luma([grays[(u * 8 / width) as usize]]))
}

/// Compares two images.
fn same(found: &GrayImage, expected: &GrayImage) -> Outcome {
    near(found, expected, 0)
}

/// Compares two images, whose values may differ by so much. The message shows the distinct values of the first row.
fn near(found: &GrayImage, expected: &GrayImage, tolerance: u8) -> Outcome {
    let are_near = found.as_raw().iter().zip(expected.as_raw()).all(|(a, b)| a.abs_diff(*b) <= tolerance);
    if found.dimensions() == expected.dimensions() && are_near {
        return Ok(());
    }
    let summary = |image: &GrayImage| {
        let mut row: Vec<u8> = image.rows().next().map(|row| row.map(|pixel| pixel.0[0]).collect()).unwrap_or_default();
        row.dedup();
        row.truncate(20);
        format!("{:?} with {row:?} in its first row", image.dimensions())
    };
    Err(format!("found {}, expected {}", summary(found), summary(expected)).into())
}

/// Captures. This must fail, with a fault that `is_expected` accepts and a one-line message that
/// names the device.
fn fails(camera: &mut V4l2Camera, device: &str, is_expected: impl Fn(&CameraFault) -> bool) -> Outcome {
    let error = match camera.frame(SHORT, &AtomicBool::new(false)) {
        Ok(_) => return Err("there is a picture".into()),
        Err(error) => error,
    };
    let message = error.to_string();
    let is_clear = message.starts_with(&format!("{device}: ")) && !message.contains('\n');
    match is_expected(&error.fault) && is_clear {
        true => Ok(()),
        false => Err(format!("{error:?}").into()),
    }
}

/// Checks that the next two captures work.
fn recovers(camera: &mut V4l2Camera) -> Outcome {
    for _ in 0..2 {
        same(&frame(camera)?, &bars([320, 180], &FULL))?;
    }
    Ok(())
}

/// Frames show the bars, in the same colours whether planes have memory of their own or not.
fn format(format: PixelFormat, grays: &[u8; 8]) -> Outcome {
    for size in [[640, 480], [320, 180]] {
        let picture = |device| -> Result<Picture, Box<dyn Error>> {
            cameras::show(Path::new(device), Pattern::Bars)?;
            let mut camera = open(device, &CameraSettings { format: Some(format), size: Some(size), ..quick() })?;
            Ok(camera.frame(LONG, &AtomicBool::new(false))?)
        };
        let [single, multiple] = [picture(VIVID[0])?, picture(MULTIPLANAR)?];
        // Luma and chroma are rounded to colours, whose grey is the luma but for that.
        near(&single.to_gray(), &bars(size, grays), u8::from(grays == &LIMITED))?;
        if multiple != single {
            near(&multiple.to_gray(), &single.to_gray(), 0)?;
            return Err("the colours differ".into());
        }
    }
    Ok(())
}

/// By default, the best format and the camera's current size are used.
fn defaults() -> Outcome {
    cameras::show(Path::new(VIVID[0]), Pattern::Bars)?;
    drop(open(VIVID[0], &CameraSettings { format: Some(PixelFormat::Yuyv), ..quick() })?);
    let mut camera = open(VIVID[0], &CameraSettings { average: NonZeroU16::MIN.saturating_add(4), ..CameraSettings::default() })?;
    let layout = camera.layout();
    if (layout.format, layout.size) != (PixelFormat::Nv12, [320, 180]) {
        return Err(format!("{camera}").into());
    }
    near(&frame(&mut camera)?, &bars([320, 180], &LIMITED), 1)?;
    match camera.to_string() {
        text if text == "/dev/video0 (vivid), 320x180 NV12" => Ok(()),
        text => Err(text.into()),
    }
}

/// Frames exposed before a capture are not used.
fn frames_are_of_now() -> Outcome {
    let device = Path::new(VIVID[0]);
    let mut camera = open(VIVID[0], &quick())?;
    for i in 0..6 {
        let (pattern, gray) = if i % 2 == 0 { (Pattern::White, FULL[0]) } else { (Pattern::Black, FULL[7]) };
        cameras::show(device, pattern)?;
        same(&frame(&mut camera)?, &GrayImage::from_pixel(320, 180, Luma([gray])))?;
        // Until all buffers hold this pattern.
        thread::sleep(Duration::from_millis(300));
    }
    Ok(())
}

const AUTOGAIN: u32 = 0x0098_0912;
const GAIN: u32 = 0x0098_0913;

/// The value of a control of the first camera.
fn control(id: u32) -> Result<Value, Box<dyn Error>> {
    Ok(Device::with_path(VIVID[0])?.control(id)?.value)
}

fn locks_and_unlocks() -> Outcome {
    let put = |id, value| Device::with_path(VIVID[0])?.set_control(Control { id, value });
    put(AUTOGAIN, Value::Boolean(true))?;
    let expect = |what: &str, id, expected: Value| match control(id)? {
        value if value == expected => Ok(()),
        value => Err(Box::<dyn Error>::from(format!("{what}: {value:?} instead of {expected:?}"))),
    };
    for gain in [None, Some(77)] {
        let mut camera = open(VIVID[0], &CameraSettings { lock: true, gain, ..quick() })?;
        expect("opened", AUTOGAIN, Value::Boolean(true))?;
        for _ in 0..2 {
            frame(&mut camera)?;
            expect("locked", AUTOGAIN, Value::Boolean(false))?;
            if let Some(gain) = gain {
                expect("set", GAIN, Value::Integer(gain.into()))?;
            }
        }
        drop(camera);
        expect("closed", AUTOGAIN, Value::Boolean(true))?;
    }
    // Settings of the user are restored.
    put(AUTOGAIN, Value::Boolean(false))?;
    put(GAIN, Value::Integer(50))?;
    let mut camera = open(VIVID[0], &CameraSettings { lock: true, gain: Some(60), ..quick() })?;
    frame(&mut camera)?;
    expect("set", GAIN, Value::Integer(60))?;
    drop(camera);
    expect("closed", GAIN, Value::Integer(50))?;
    put(AUTOGAIN, Value::Boolean(true))?;

    let mut camera = open(VIVID[0], &CameraSettings { exposure: Some(100), ..quick() })?;
    fails(&mut camera, VIVID[0], |fault| matches!(fault, CameraFault::Control { control: "exposure", .. }))?;
    let mut camera = open(VIVID[0], &CameraSettings { gain: Some(1000), ..quick() })?;
    fails(&mut camera, VIVID[0], |fault| matches!(fault, CameraFault::Control { control: "gain", .. }))?;
    drop(camera);
    expect("closed after an error", AUTOGAIN, Value::Boolean(true))
}

/// Devices that cannot be opened are refused, with a helpful message.
fn refusals() -> Outcome {
    let refused = |device: &str, settings: &CameraSettings, words: &[&str]| match open(device, settings) {
        Ok(camera) => Err(Box::<dyn Error>::from(format!("{camera} opens"))),
        Err(error) => {
            let message = error.to_string();
            match message.starts_with(&format!("{device}: ")) && words.iter().all(|word| message.contains(word)) {
                true => Ok(()),
                false => Err(message.into()),
            }
        }
    };
    let sized = |width, height| CameraSettings { size: Some([width, height]), ..quick() };
    refused("/dev/video99", &quick(), &["no such device", "multiscopic devices"])?;
    refused("/dev/null", &quick(), &["found no V4L2 device, expected a camera"])?;
    refused("/dev", &quick(), &["cannot open it"])?;
    refused(MULTIPLANAR, &sized(333, 200), &["found 320x180 GREY, expected 333x200 GREY"])?;
    refused(LOOPBACK[0], &quick(), &["an output (a loopback device that nothing feeds"])?;
    refused(VIVID[0], &sized(333, 200), &["found 320x180 GREY, expected 333x200 GREY"])?;
    refused(VIVID[0], &sized(0, 200), &["a size of 0x200", "1 to 65535"])?;
    refused(VIVID[0], &sized(100_000, 100_000), &["a size of 100000x100000", "1 to 65535"])?;
    let compressed = CameraSettings { format: Some(PixelFormat::Mjpg), ..quick() };
    refused(VIVID[0], &compressed, &["found 320x180 ", "expected 320x180 MJPG", "multiscopic devices"])
}

/// A fault that occurs once, before the camera starts or while it runs.
fn strikes_once(fault: cameras::Fault, while_it_runs: bool, is_expected: fn(&CameraFault) -> bool) -> Outcome {
    let device = Path::new(VIVID[0]);
    cameras::show(device, Pattern::Bars)?;
    let mut camera = open(VIVID[0], &quick())?;
    for _ in 0..2 {
        if while_it_runs {
            frame(&mut camera)?;
        }
        cameras::inject(device, fault)?;
        fails(&mut camera, VIVID[0], is_expected)?;
        recovers(&mut camera)?;
        // Reopen, as at the start.
        drop(camera);
        camera = open(VIVID[0], &quick())?;
    }
    Ok(())
}

/// The driver flags a frame as damaged, which must be noticed when that frame is read.
fn damaged_frames() -> Outcome {
    let device = Path::new(VIVID[0]);
    cameras::show(device, Pattern::Bars)?;
    let mut camera = open(VIVID[0], &quick())?;
    frame(&mut camera)?;
    let is_over = AtomicBool::new(false);
    let failed = thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                let _ = cameras::inject(device, cameras::Fault::Damaged);
                thread::sleep(Duration::from_millis(2));
            }
        });
        let failed =
            fails(&mut camera, VIVID[0], |fault| matches!(fault, CameraFault::Damaged)).map_err(|error| error.to_string());
        is_over.store(true, Ordering::Relaxed);
        failed
    });
    failed?;
    recovers(&mut camera)
}

/// No frames arrive, at the start or while the camera runs.
fn no_frames() -> Outcome {
    let device = Path::new(VIVID[0]);
    cameras::show(device, Pattern::Bars)?;
    let mut camera = open(VIVID[0], &quick())?;
    for _ in 0..2 {
        cameras::inject(device, cameras::Fault::Dropped(100))?;
        for _ in 0..2 {
            fails(&mut camera, VIVID[0], |fault| matches!(fault, CameraFault::NoFrame { frames: 0, .. }))?;
        }
        cameras::inject(device, cameras::Fault::Dropped(0))?;
        recovers(&mut camera)?;
    }
    Ok(())
}

fn cancelling() -> Outcome {
    let device = Path::new(VIVID[0]);
    cameras::show(device, Pattern::Bars)?;
    let mut camera = open(VIVID[0], &quick())?;
    cameras::inject(device, cameras::Fault::Dropped(100))?;
    let is_cancelled = AtomicBool::new(false);
    let cancelled = thread::scope(|scope| {
        scope.spawn(|| {
            // Most often it waits for a frame by then.
            thread::sleep(Duration::from_millis(500));
            is_cancelled.store(true, Ordering::Relaxed);
        });
        camera.frame(LONG, &is_cancelled)
    });
    cameras::inject(device, cameras::Fault::Dropped(0))?;
    match cancelled {
        Err(error) if matches!(error.fault, CameraFault::Cancelled) => recovers(&mut camera),
        other => Err(format!("{other:?}").into()),
    }
}

/// A device is busy while another capture runs.
fn second_opener() -> Outcome {
    cameras::show(Path::new(VIVID[0]), Pattern::Bars)?;
    let mut first = open(VIVID[0], &quick())?;
    let mut second = open(VIVID[0], &quick())?;
    frame(&mut first)?;
    fails(&mut second, VIVID[0], |fault| matches!(fault, CameraFault::Busy))?;
    match open(VIVID[0], &CameraSettings { size: Some([640, 480]), ..quick() }) {
        Err(error) if matches!(error.fault, CameraFault::Busy) => {}
        other => return Err(format!("{:?}", other.map(|camera| camera.to_string())).into()),
    }
    recovers(&mut first)?;
    drop(first);
    recovers(&mut second)
}

/// A random frame of this layout.
fn random_frame(layout: &FrameLayout, seed: u64) -> Vec<u8> {
    let bytes = cameras::frame_bytes(layout.format, layout.size.map(|side| side as usize));
    let mut random = Random(seed);
    (0..bytes).map(|_| random.byte()).collect()
}

/// Frames come back as they were fed, in every format, and without delay.
fn loopback_formats() -> Outcome {
    let mut formats = Vec::new();
    for (i, format) in PixelFormat::ALL.into_iter().enumerate().filter(|(_, format)| !format.is_compressed()) {
        let layout = FrameLayout { format, size: [64, 48], stride: 0 };
        let device = LOOPBACK[i % LOOPBACK.len()];
        let fed = random_frame(&layout, 1);
        let producer = match Producer::start(Path::new(device), layout, fed.clone()) {
            Ok(producer) => producer,
            // The driver supports fewer formats.
            Err(error) if error.kind() == ErrorKind::Unsupported => continue,
            Err(error) => return Err(error.into()),
        };
        formats.push(format.name());
        let mut camera = open(device, &CameraSettings { format: Some(format), size: None, ..quick() })?;
        let mut is_fed = |fed: &[u8]| match camera.frame(LONG, &AtomicBool::new(false))? == layout.to_picture(fed)? {
            true => Outcome::Ok(()),
            false => Err(format!("another picture of {}", format.name()).into()),
        };
        is_fed(&fed)?;
        for seed in 2..5 {
            let fed = random_frame(&layout, seed);
            producer.show_now(fed.clone());
            is_fed(&fed)?;
        }
    }
    match formats.contains(&"GREY") && formats.contains(&"YUYV") && formats.len() >= 4 {
        true => Ok(()),
        false => Err(format!("{formats:?}").into()),
    }
}

/// Whole JPEG frames are decoded; damaged ones are errors.
fn loopback_jpeg() -> Outcome {
    let (device, layout) = (LOOPBACK[0], FrameLayout { format: PixelFormat::Mjpg, size: [64, 48], stride: 0 });
    let image = GrayImage::from_fn(64, 48, |u, v| Luma([(3 * u + v) as u8]));
    let mut bytes = Vec::new();
    JpegEncoder::new(&mut bytes).encode_image(&image)?;
    let file = Path::new("/tmp/frame.jpg");
    std::fs::write(file, &bytes)?;
    let expected = Picture::read(file)?.to_gray();

    let producer = Producer::start(Path::new(device), layout, bytes.clone())?;
    let mut camera = open(device, &CameraSettings { format: None, size: None, ..quick() })?;
    same(&frame(&mut camera)?, &expected)?;
    producer.show_now(bytes[..bytes.len() / 2].to_vec());
    fails(&mut camera, device, |fault| matches!(fault, CameraFault::Jpeg { .. }))?;
    producer.show_now(bytes);
    same(&frame(&mut camera)?, &expected)
}

/// Frames with too few bytes are errors.
fn loopback_short_frames() -> Outcome {
    let image = GrayImage::from_fn(64, 48, |u, v| Luma([(u * v) as u8]));
    let producer = Producer::gray(Path::new(LOOPBACK[1]), &image)?;
    let mut camera = open(LOOPBACK[1], &CameraSettings { size: None, ..quick() })?;
    same(&frame(&mut camera)?, &image)?;
    producer.show_now(image.as_raw()[..1000].to_vec());
    fails(&mut camera, LOOPBACK[1], |fault| matches!(fault, CameraFault::Truncated { found: 1000, expected: 3072, .. }))?;
    producer.show_now(image.as_raw().clone());
    same(&frame(&mut camera)?, &image)
}

/// A camera whose producer ends works again with the next producer.
fn loopback_producer_ends() -> Outcome {
    let image = GrayImage::from_fn(64, 48, |u, v| Luma([(u ^ v) as u8]));
    let producer = Producer::gray(Path::new(LOOPBACK[2]), &image)?;
    let mut camera = open(LOOPBACK[2], &CameraSettings { size: None, ..quick() })?;
    same(&frame(&mut camera)?, &image)?;
    drop(producer);
    fails(&mut camera, LOOPBACK[2], |_| true)?;
    let _producer = Producer::gray(Path::new(LOOPBACK[2]), &image)?;
    same(&frame(&mut camera)?, &image)
}

/// Five cameras deliver the five frames of a capture exactly.
fn five_cameras() -> Outcome {
    let images =
        golden::paths().iter().map(|file| Ok(Picture::read(file)?.to_gray())).collect::<multiscopic::Result<Vec<_>>>()?;
    let producers = LOOPBACK.iter().zip(&images).map(|(device, image)| Producer::gray(Path::new(device), image));
    let _producers = producers.collect::<Result<Vec<_>, _>>()?;
    let settings = CameraSettings { size: None, average: NonZeroU16::MIN.saturating_add(2), ..quick() };
    for (device, image) in LOOPBACK.into_iter().zip(&images) {
        same(&frame(&mut open(device, &settings)?)?, image)?;
    }
    Ok(())
}

/// The output of `multiscopic devices` with `arguments`, run as `user`.
fn devices(arguments: &[&str], user: u32) -> Result<(String, String), Box<dyn Error>> {
    let output = Command::new(program::binary()).arg("devices").args(arguments).uid(user).output()?;
    let text = |bytes| String::from_utf8(bytes);
    match output.status.success() {
        true => Ok((text(output.stdout)?, text(output.stderr)?)),
        false => Err(format!("{output:?}").into()),
    }
}

fn lists_devices() -> Outcome {
    let _producer = Producer::gray(Path::new(LOOPBACK[3]), &GrayImage::new(64, 48))?;
    let (text, _) = devices(&[], 0)?;
    for words in [
        "/dev/video0: vivid (vivid, platform:vivid-000)\n",
        "    GREY (8-bit Greyscale): 320x180, 640x360, 640x480, 1280x720",
        "/dev/video2: vivid (vivid, platform:vivid-002)\n",
        "    NM12 (",
        "    not supported: ",
        "/dev/video13: ",
    ] {
        if !text.contains(words) {
            return Err(format!("no {words:?} in {text}").into());
        }
    }
    let list: Vec<serde_json::Value> = serde_json::from_str(&devices(&["--json"], 0)?.0)?;
    let paths: Vec<_> = list.iter().filter_map(|camera| camera["device"].as_str()).collect();
    if paths != [VIVID[0], VIVID[1], MULTIPLANAR, LOOPBACK[3]] || !list[2]["problem"].is_null() {
        return Err(format!("{list:#?}").into());
    }
    let formats = list[0]["formats"].as_array().ok_or("a list of formats")?;
    let supported: BTreeSet<_> =
        formats.iter().filter(|format| format["is_supported"] == true).filter_map(|format| format["format"].as_str()).collect();
    let expected: BTreeSet<_> =
        PixelFormat::ALL.into_iter().filter(|format| !format.is_compressed()).map(PixelFormat::name).collect();
    let grey = formats.iter().find(|format| format["format"] == "GREY").ok_or("GREY")?;
    if supported != expected || grey["sizes"][2] != serde_json::json!([640, 480]) {
        return Err(format!("{supported:?}, {grey}").into());
    }
    let (text, _) = devices(&[], 1000)?;
    match text.contains("/dev/video0\n    cannot be used: permission denied; become a member of its group") {
        true => Ok(()),
        false => Err(text.into()),
    }
}

/// The second camera is independent of the first.
fn second_camera() -> Outcome {
    cameras::show(Path::new(VIVID[0]), Pattern::Black)?;
    cameras::show(Path::new(VIVID[1]), Pattern::Bars)?;
    let mut cameras = [open(VIVID[0], &quick())?, open(VIVID[1], &quick())?];
    same(&frame(&mut cameras[0])?, &GrayImage::new(320, 180))?;
    recovers(&mut cameras[1])?;
    let now = Capture::format(&Device::with_path(VIVID[1])?)?;
    match [now.width, now.height] == [320, 180] {
        true => Ok(()),
        false => Err(now.to_string().into()),
    }
}

/// The tests, which are ignored without cameras.
pub fn trials(has_cameras: bool) -> Vec<Trial> {
    let mut trials = Vec::new();
    let mut test = |name: &str, run: Box<dyn Fn() -> Outcome + Send>| {
        let run = move || run().map_err(|error| error.to_string().into());
        trials.push(Trial::test(format!("v4l2::{name}"), run).with_ignored_flag(!has_cameras));
    };
    for (pixels, grays) in [
        (PixelFormat::Grey, &FULL),
        (PixelFormat::Y10, &FULL),
        (PixelFormat::Y12, &FULL),
        (PixelFormat::Y16, &FULL),
        (PixelFormat::Yuyv, &LIMITED),
        (PixelFormat::Yvyu, &LIMITED),
        (PixelFormat::Uyvy, &LIMITED),
        (PixelFormat::Vyuy, &LIMITED),
        (PixelFormat::Nv12, &LIMITED),
        (PixelFormat::Nv21, &LIMITED),
        (PixelFormat::Yu12, &LIMITED),
        (PixelFormat::Yv12, &LIMITED),
        (PixelFormat::Rgb3, &COLORS),
        (PixelFormat::Bgr3, &COLORS),
    ] {
        test(&format!("format::{}", pixels.name()), Box::new(move || format(pixels, grays)));
    }
    test("format::bars_are_known", Box::new(bars_are_known));
    test("defaults", Box::new(defaults));
    test("second_camera", Box::new(second_camera));
    test("frames_are_of_now", Box::new(frames_are_of_now));
    test("locks_and_unlocks", Box::new(locks_and_unlocks));
    test("refusals", Box::new(refusals));
    test("lists_devices", Box::new(lists_devices));
    test("fault::no_frames", Box::new(no_frames));
    test("fault::damaged_frames", Box::new(damaged_frames));
    let is_refused: fn(&CameraFault) -> bool = |fault| matches!(fault, CameraFault::System { .. });
    for (name, fault, while_it_runs, is_expected) in [
        ("fault::buffers", cameras::Fault::Buffers, false, is_refused),
        ("fault::queue", cameras::Fault::Queue, false, is_refused),
        ("fault::queue_while_it_runs", cameras::Fault::Queue, true, is_refused),
        ("fault::start", cameras::Fault::Start, false, is_refused),
        ("fault::fatal", cameras::Fault::Fatal, true, is_refused),
        ("fault::disconnected", cameras::Fault::Disconnected, true, |fault| matches!(fault, CameraFault::Disconnected)),
        ("fault::disconnected_at_first", cameras::Fault::Disconnected, false, |fault| matches!(fault, CameraFault::Disconnected)),
    ] {
        test(name, Box::new(move || strikes_once(fault, while_it_runs, is_expected)));
    }
    test("fault::cancelling", Box::new(cancelling));
    test("fault::second_opener", Box::new(second_opener));
    test("loopback::formats", Box::new(loopback_formats));
    test("loopback::jpeg", Box::new(loopback_jpeg));
    test("loopback::short_frames", Box::new(loopback_short_frames));
    test("loopback::producer_ends", Box::new(loopback_producer_ends));
    test("loopback::five_cameras", Box::new(five_cameras));
    trials
}
