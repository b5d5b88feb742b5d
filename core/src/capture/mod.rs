//! Active perception: moving the camera and taking the frames. Each module knows only those above it:
//!
//! | room | what it is |
//! | --- | --- |
//! | `position` | [`Position`]: where the camera is |
//! | `plan` | [`Plan`]: the frames of a capture and their positions |
//! | `stage` | [`Stage`], which moves the camera: implemented for hardware |
//! | `camera` | [`Camera`], which takes the frames: implemented for hardware |
//! | `policy` | [`Policy`]: waiting times, retries and tolerances |
//! | `error` | [`CaptureError`]: why captures fail |
//! | `sequence` | [`Sequence`]: moves, settles, captures, checks, and goes on to the next position |
//!
//! The same sequence runs on a host and on a microcontroller. It is a state machine that is polled with the
//! time and never waits, so the caller is free to do other work in between.
//!
//! ```
//! use core::{convert::Infallible, time::Duration};
//! use multiscopic_core::Views;
//! use multiscopic_core::capture::{Camera, Plan, Policy, Position, CaptureProgress, Sequence, Stage};
//!
//! /// A stage that arrives at once.
//! struct Teleport(Option<Position>);
//!
//! impl Stage for Teleport {
//!     type Error = Infallible;
//!
//!     fn move_to(&mut self, position: Position) -> Result<(), Infallible> {
//!         self.0 = Some(position);
//!         Ok(())
//!     }
//!
//!     fn has_arrived(&mut self) -> Result<bool, Infallible> {
//!         Ok(true)
//!     }
//!
//!     fn position(&mut self) -> Result<Option<Position>, Infallible> {
//!         Ok(self.0)
//!     }
//!
//!     fn stop(&mut self) -> Result<(), Infallible> {
//!         Ok(())
//!     }
//! }
//!
//! /// A camera that counts its frames.
//! struct Counter(usize);
//!
//! impl Camera for Counter {
//!     type Error = Infallible;
//!
//!     fn begin(&mut self) -> Result<(), Infallible> {
//!         Ok(())
//!     }
//!
//!     fn start(&mut self, _: usize) -> Result<(), Infallible> {
//!         self.0 += 1;
//!         Ok(())
//!     }
//!
//!     fn is_complete(&mut self) -> Result<bool, Infallible> {
//!         Ok(true)
//!     }
//!
//!     fn end(&mut self) -> Result<(), Infallible> {
//!         Ok(())
//!     }
//! }
//!
//! let plan = Plan::new(Views::CROSS, 20_000);
//! let policy = Policy { settle: Duration::from_millis(300), ..Policy::default() };
//! let (mut stage, mut camera) = (Teleport(None), Counter(0));
//! let mut sequence = Sequence::new(plan.positions(), policy);
//! let mut now = Duration::ZERO;
//! while sequence.poll(now, &mut stage, &mut camera).unwrap() != CaptureProgress::Done {
//!     now += Duration::from_millis(10); // a clock
//! }
//! assert_eq!((camera.0, stage.0), (5, Some(Position::CENTER)));
//! assert!(now > Duration::from_millis(5 * 300));
//! ```

mod camera;
mod error;
mod plan;
mod policy;
mod position;
mod sequence;
mod stage;

pub use camera::Camera;
pub use error::CaptureError;
pub use plan::Plan;
pub use policy::Policy;
pub use position::Position;
pub use sequence::{CaptureProgress, Sequence};
pub use stage::Stage;
