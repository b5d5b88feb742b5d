//! The thread of the camera and the stage: it shows what the camera sees, and takes sets of frames.

use std::{
    fs,
    io::Cursor,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use image::{GrayImage, codecs::jpeg::JpegEncoder};
use multiscopic::{Error, Picture, Result, Rig, capture::ImageCamera as _};
use multiscopic_core::capture::Camera as _;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::{
    notice_board::{NoticeBoard, Subject},
    server::Messages,
    tuned_rig::TunedRig,
    workbench::{Wish, Workbench},
};
use crate::command::{
    advice,
    capture::{Recorder, free_folders},
    terminal,
};

/// The quality of pictures of the preview. Its measures are those of the frame itself.
const JPEG_QUALITY: u8 = 80;
/// The least time between two pictures of the preview.
const BETWEEN_PICTURES: Duration = Duration::from_millis(60);
/// The time between two looks at the camera and the orders.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// The time after a failure until the camera is opened again.
const AFTER_FAILURE: Duration = Duration::from_secs(2);
/// The most folders that the page lists.
const MOST_FOLDERS: usize = 100;

/// A message of a page of `live`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Message {
    /// Match with these settings.
    Match(Wish),
    /// Take a set.
    Take,
    /// Stop taking it.
    Stop,
    /// Open the folder of this name.
    Open(String),
}

/// The next order to the thread.
#[derive(Debug)]
enum Order {
    Take,
    Open(String),
}

/// The orders of pages, and the folder of the sets.
pub struct Studio {
    bench: Arc<Workbench>,
    output: PathBuf,
    order: Mutex<Option<Order>>,
    /// Each increase stops a capture: at the first one the stage returns to the centre, at the second it stops where it is.
    stops: Arc<AtomicUsize>,
    /// The number of signals that have come.
    signals: AtomicUsize,
}

impl Studio {
    /// A studio that puts its sets into folders within `output`.
    pub fn new(bench: Arc<Workbench>, output: &Path) -> Studio {
        Studio { bench, output: output.into(), order: Mutex::default(), stops: Arc::default(), signals: AtomicUsize::new(0) }
    }

    /// Ends the studio: at the first signal as soon as the stage has returned, at the second at once.
    pub fn receive(&self, signals: usize) {
        let before = self.signals.swap(signals, Ordering::Relaxed);
        self.stops.fetch_add(signals - before, Ordering::Relaxed);
    }

    fn has_ended(&self) -> bool {
        self.signals.load(Ordering::Relaxed) > 0
    }

    fn order(&self, order: Order) {
        *self.order.lock().unwrap_or_else(PoisonError::into_inner) = Some(order);
    }

    fn next_order(&self) -> Option<Order> {
        self.order.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn has_order(&self) -> bool {
        self.order.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Runs the camera and the stage until a signal comes.
    pub fn run(&self, mut recorder: Recorder) {
        recorder.hardware.interrupts = self.stops.clone();
        let newest = self.folders().into_iter().next();
        self.tell_history(newest.as_deref());
        if let Some(name) = newest {
            self.open(&name);
        }
        let mut is_on = false;
        while !self.has_ended() {
            match self.next_order() {
                Some(order) => {
                    switch_off(&mut recorder, &mut is_on);
                    match order {
                        Order::Take => self.take_set(&mut recorder),
                        Order::Open(name) => self.open(&name),
                    }
                }
                // Without anyone who looks, the camera rests.
                None if self.bench.board.readers() == 0 => {
                    switch_off(&mut recorder, &mut is_on);
                    thread::sleep(BETWEEN_PICTURES);
                }
                None => {
                    if let Err(error) = self.preview(&mut recorder, &mut is_on) {
                        self.bench.board.put(Subject::Preview, json!({ "failure": advice::error(&error) }));
                        switch_off(&mut recorder, &mut is_on);
                        self.wait(AFTER_FAILURE);
                    }
                }
            }
        }
        switch_off(&mut recorder, &mut is_on);
    }

    /// Waits, unless there is something to do.
    fn wait(&self, time: Duration) {
        let start = Instant::now();
        while start.elapsed() < time && !self.has_ended() && !self.has_order() {
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Shows a picture of the camera, unless an order comes before it is there.
    fn preview(&self, recorder: &mut Recorder, is_on: &mut bool) -> Result<()> {
        let start = Instant::now();
        let camera = &mut recorder.hardware.camera;
        if !*is_on {
            camera.begin()?;
            *is_on = true;
        }
        camera.start(0)?;
        while !camera.is_complete()? {
            if self.has_ended() || self.has_order() {
                return Ok(());
            }
            thread::sleep(POLL_INTERVAL);
        }
        if let Some(frame) = camera.take_image(0) {
            let (width, height) = frame.dimensions();
            let meters = FrameMeters::of(&frame.to_gray());
            let contents = json!({ "picture": jpeg(&frame), "width": width, "height": height, "meters": meters });
            self.bench.board.put(Subject::Preview, contents);
        }
        self.wait(BETWEEN_PICTURES.saturating_sub(start.elapsed()));
        Ok(())
    }

    fn take_set(&self, recorder: &mut Recorder) {
        let tell = |step: &str, done: usize, total: usize| {
            let contents = json!({ "step": step, "done": done, "total": total, "is_running": true });
            self.bench.board.put(Subject::Capture, contents);
        };
        tell("opening the camera", 0, recorder.plan.frames().len());
        let outcome = match free_folders(&self.output).next() {
            Some(folder) => recorder.record(&folder, &mut |step, done, total| tell(step, done, total)).map(|_| folder),
            None => Err(Error::Usage(format!("{} is full, give another folder", self.output.display()))),
        };
        match outcome {
            Ok(folder) => {
                let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
                self.bench.board.put(Subject::Capture, json!({ "step": format!("{name} is taken"), "is_running": false }));
                self.open(&name);
            }
            Err(error) => {
                terminal::complain(&advice::error(&error));
                self.bench.board.put(Subject::Capture, json!({ "failure": advice::error(&error), "is_running": false }));
            }
        }
    }

    /// Opens a set, if there is one of this name.
    fn open(&self, name: &str) {
        if !self.folders().iter().any(|known| known == name) {
            return;
        }
        match TunedRig::open(&self.output.join(name)) {
            Ok(rig) => {
                self.bench.open(rig);
                self.tell_history(Some(name));
            }
            Err(error) => {
                self.bench.board.put(Subject::Capture, json!({ "failure": advice::error(&error), "is_running": false }));
            }
        }
    }

    fn tell_history(&self, current: Option<&str>) {
        self.bench.board.put(Subject::History, json!({ "folders": self.folders(), "current": current }));
    }

    /// The names of the sets, the newest first.
    fn folders(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.output).into_iter().flatten().flatten();
        let sets = entries.filter(|entry| entry.path().join(Rig::FILE_NAME).is_file());
        let mut names: Vec<String> = sets.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort_unstable_by(|a, b| b.cmp(a));
        names.truncate(MOST_FOLDERS);
        names
    }
}

impl Messages for Studio {
    fn board(&self) -> &NoticeBoard {
        &self.bench.board
    }

    fn take(&self, text: &str) -> std::result::Result<(), String> {
        match serde_json::from_str(text).map_err(|error| error.to_string())? {
            Message::Match(wish) => self.bench.ask(wish),
            Message::Take => self.order(Order::Take),
            Message::Stop => {
                self.stops.fetch_add(1, Ordering::Relaxed);
            }
            Message::Open(name) => self.order(Order::Open(name)),
        }
        Ok(())
    }
}

/// Closes the camera. What it says then no longer matters.
fn switch_off(recorder: &mut Recorder, is_on: &mut bool) {
    if std::mem::take(is_on) {
        let _ = recorder.hardware.camera.end();
    }
}

fn jpeg(frame: &Picture) -> String {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
    let encoded = match frame {
        Picture::Gray(gray) => encoder.encode_image(gray),
        frame => encoder.encode_image(&frame.to_rgb()),
    };
    encoded.expect("memory takes any picture");
    format!("data:image/jpeg;base64,{}", STANDARD.encode(bytes.into_inner()))
}

/// Bins of the histogram.
const BINS: usize = 64;

/// Measures of a frame, to focus and to expose by.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct FrameMeters {
    /// Its sharpness: the root mean square of the second differences of grey between neighbouring pixels, in percent of the
    /// mean. It does not depend on the brightness.
    focus: f64,
    /// The mean of grey, from 0 to 255.
    mean: f64,
    /// The share of pixels that are white, where the sensor has taken as much light as it can.
    white: f64,
    /// The share of black pixels.
    black: f64,
    /// The numbers of pixels by grey, in equal bins.
    histogram: Vec<u32>,
}

impl FrameMeters {
    /// The measures of a frame.
    fn of(frame: &GrayImage) -> FrameMeters {
        let pixels = frame.as_raw();
        let mut counts = [0_u32; 256];
        pixels.iter().for_each(|&gray| counts[usize::from(gray)] += 1);
        let count = pixels.len().max(1) as f64;
        let mean = counts.iter().zip(0..).map(|(&count, gray): (_, u32)| f64::from(count) * f64::from(gray)).sum::<f64>() / count;
        let share = |gray: usize| f64::from(counts[gray]) / count;
        let focus = if mean > 0.0 { 100.0 * sharpness(frame) / mean } else { 0.0 };
        let histogram = counts.chunks(256 / BINS).map(|bin| bin.iter().sum()).collect();
        FrameMeters { focus, mean, white: share(255), black: share(0), histogram }
    }
}

/// The root mean square of second differences, along rows and columns together.
fn sharpness(frame: &GrayImage) -> f64 {
    let (width, height) = (frame.width() as usize, frame.height() as usize);
    if width < 3 || height < 3 {
        return 0.0;
    }
    let pixels = frame.as_raw();
    let at = |u: usize, v: usize| i64::from(pixels[v * width + u]);
    let laplacian = |u, v| at(u - 1, v) + at(u + 1, v) + at(u, v - 1) + at(u, v + 1) - 4 * at(u, v);
    let squares = (1..height - 1).flat_map(|v| (1..width - 1).map(move |u| laplacian(u, v).pow(2)));
    (squares.sum::<i64>() as f64 / ((width - 2) * (height - 2)) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use image::imageops;

    use super::*;

    /// Stripes of two greys.
    fn stripes(dark: u8, bright: u8) -> GrayImage {
        GrayImage::from_fn(64, 48, |u, _| [if u / 4 % 2 == 0 { dark } else { bright }].into())
    }

    #[test]
    fn what_is_blurred_is_less_sharp() {
        let sharp = FrameMeters::of(&stripes(40, 120)).focus;
        let blurred = [1.0, 2.0].map(|sigma| FrameMeters::of(&imageops::blur(&stripes(40, 120), sigma)).focus);
        assert!(sharp > 1.5 * blurred[0] && blurred[0] > 1.5 * blurred[1], "{sharp} {blurred:?}");
    }

    #[test]
    fn brightness_does_not_change_sharpness() {
        let [dark, bright] = [stripes(20, 60), stripes(80, 240)].map(|frame| FrameMeters::of(&frame).focus);
        assert!((dark - bright).abs() < 1e-9, "{dark} {bright}");
    }

    #[test]
    fn exposure_counts_pixels() {
        let frame = GrayImage::from_fn(10, 10, |u, v| {
            [if v == 0 {
                255
            } else if u < 5 {
                0
            } else {
                100
            }]
            .into()
        });
        let meters = FrameMeters::of(&frame);
        assert_eq!([meters.white, meters.black], [0.1, 0.45]);
        assert!((meters.mean - (10.0 * 255.0 + 45.0 * 100.0) / 100.0).abs() < 1e-9);
        assert_eq!((meters.histogram.len(), meters.histogram[0], meters.histogram[25], meters.histogram[63]), (64, 45, 45, 10));
        assert_eq!(FrameMeters::of(&GrayImage::new(2, 2)).focus, 0.0);
    }
}
