//! The frames of a capture and their positions.

use super::position::Position;
use crate::{Frame, Views};

const MAX_FRAMES: usize = 1 + Views::MAX;

/// The frames of a capture in the order in which they are taken, the centre first, and their positions.
///
/// ```
/// use multiscopic_core::{Frame, View, Views, capture::{Plan, Position}};
/// let plan = Plan::new(Views::HORIZONTAL, 20_000);
/// assert_eq!(plan.frames()[1], Frame::View(View::LEFT));
/// assert_eq!(plan.positions()[1], Position { x_um: -20_000, y_um: 0 });
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    frames: [Frame; MAX_FRAMES],
    positions: [Position; MAX_FRAMES],
    len: usize,
}

impl Plan {
    /// The centre and its neighbours. The baseline is in micrometres.
    pub fn new(views: Views, baseline_um: u32) -> Plan {
        let mut frames = [Frame::Center; MAX_FRAMES];
        for (frame, view) in frames.iter_mut().skip(1).zip(views.iter()) {
            *frame = Frame::View(view);
        }
        Plan { frames, positions: frames.map(|frame| Position::of(frame, baseline_um)), len: 1 + views.len() }
    }

    /// The frames.
    pub fn frames(&self) -> &[Frame] {
        self.frames.get(..self.len).unwrap_or_default()
    }

    /// The position of each frame.
    pub fn positions(&self) -> &[Position] {
        self.positions.get(..self.len).unwrap_or_default()
    }
}
