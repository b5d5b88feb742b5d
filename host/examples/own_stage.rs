//! A stage and a camera of one's own: what a capture needs of them, and how it runs both.
//!
//! The slide here is simulated, as its maker's library might drive it, and the camera sees a wall whose texture moves with it.
//!
//! ```sh
//! cargo run --release -p multiscopic --example own_stage
//! ```

use std::{
    convert::Infallible,
    fmt,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicUsize},
    },
    time::{Duration, Instant},
};

use image::{GrayImage, Luma};
use multiscopic::{
    Engine, Method, Picture,
    capture::{BlockingCamera, ThreadedCamera, acquire_images, stage::PosedStage},
};
use multiscopic_core::{
    Fusion, SearchConfig, Views,
    capture::{Plan, Policy, Position, Stage},
};

/// Pixels that the wall moves in the picture for each millimetre of the camera.
const PX_PER_MM: f64 = 0.8;
/// One baseline, in thousandths of a millimetre.
const BASELINE_UM: u32 = 10_000;

/// An XY slide. It moves at 200 mm/s.
struct Slide {
    from: Position,
    to: Position,
    departure: Instant,
    /// The place of the camera, which sees by it.
    place: Arc<Mutex<Position>>,
}

/// The slide was sent further than it can go.
#[derive(Debug)]
struct TooFar(Position);

impl fmt::Display for TooFar {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "the slide reaches 50 mm to each side, not ({}, {}) um", self.0.x_um, self.0.y_um)
    }
}

impl std::error::Error for TooFar {}

impl Slide {
    /// Returns the place at which it is by now, and true if that is where it was sent.
    fn update(&mut self) -> (Position, bool) {
        let way = [self.to.x_um - self.from.x_um, self.to.y_um - self.from.y_um].map(f64::from);
        let whole = way[0].hypot(way[1]) / 200_000.0;
        let share = if whole > 0.0 { (self.departure.elapsed().as_secs_f64() / whole).min(1.0) } else { 1.0 };
        let [x_um, y_um] = [self.from.x_um + (share * way[0]) as i32, self.from.y_um + (share * way[1]) as i32];
        let position = if share < 1.0 { Position { x_um, y_um } } else { self.to };
        *self.place.lock().expect("the camera does not panic") = position;
        (position, share >= 1.0)
    }
}

impl Stage for Slide {
    type Error = TooFar;

    fn move_to(&mut self, position: Position) -> Result<(), TooFar> {
        if position.x_um.abs().max(position.y_um.abs()) > 50_000 {
            return Err(TooFar(position));
        }
        (self.from, self.to, self.departure) = (self.update().0, position, Instant::now());
        Ok(())
    }

    // No call waits: the sequence asks again.
    fn has_arrived(&mut self) -> Result<bool, TooFar> {
        Ok(self.update().1)
    }

    fn position(&mut self) -> Result<Option<Position>, TooFar> {
        Ok(Some(self.update().0))
    }

    fn stop(&mut self) -> Result<(), TooFar> {
        self.to = self.update().0;
        Ok(())
    }
}

/// It counts its steps, and measures nothing else.
impl PosedStage for Slide {}

/// A camera that is carried by the slide.
struct Eye {
    place: Arc<Mutex<Position>>,
}

impl BlockingCamera for Eye {
    type Error = Infallible;

    fn take(&mut self, _timeout: Duration, _is_cancelled: &AtomicBool) -> Result<Picture, Infallible> {
        let position = *self.place.lock().expect("the slide does not panic");
        let pixels = |um: i32| (f64::from(um) / 1000.0 * PX_PER_MM).round() as i64;
        let (right, down) = (pixels(position.x_um), pixels(position.y_um));
        let gray = GrayImage::from_fn(96, 64, |u, v| Luma([texture(i64::from(u) + right, i64::from(v) + down)]));
        Ok(Picture::Gray(gray))
    }
}

/// Noise that is the same each time.
fn texture(u: i64, v: i64) -> u8 {
    let bits = (u as u32).wrapping_mul(0x9e37_79b9) ^ (v as u32).wrapping_mul(0x85eb_ca6b);
    (bits.wrapping_mul(0xc2b2_ae35) >> 24) as u8
}

fn main() -> multiscopic::Result<()> {
    let place = Arc::new(Mutex::new(Position::CENTER));
    let (from, to, departure) = (Position::CENTER, Position::CENTER, Instant::now());
    let mut slide = Slide { from, to, departure, place: place.clone() };
    let mut camera = ThreadedCamera::new(move || Ok(Eye { place: place.clone() }), Duration::from_secs(1));

    let plan = Plan::new(Views::CROSS, BASELINE_UM);
    let policy = Policy { settle: Duration::from_millis(20), ..Policy::default() };
    let interrupts = AtomicUsize::new(0);
    let acquisition = acquire_images(&mut slide, &mut camera, &plan, policy, &interrupts, |time, progress| {
        println!("{:4} ms: {progress:?}", time.as_millis());
    })?;

    let frames = acquisition.frames();
    let search = SearchConfig {
        width: 96,
        height: 64,
        views: frames.views(),
        fusion: Fusion::Heuristic,
        min_disparity: 0,
        num_disparities: 16,
    }
    .checked()?;
    let map = Method::semi_global(4).disparities(&Engine::new(None, 0)?, &frames, &search, &())?;
    let expected = (f64::from(BASELINE_UM) / 1000.0 * PX_PER_MM) as f32;
    let near = map.to_float().pixels().iter().filter(|disparity| (**disparity - expected).abs() < 0.5).count();
    println!("{near} of {} pixels have the disparity of the wall, {expected} px", 96 * 64);
    assert!(near > 96 * 64 * 9 / 10);
    Ok(())
}

#[test]
fn the_slide_takes_five_frames() {
    main().expect("a capture");
}
