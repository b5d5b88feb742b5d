//! The frames of a capture and their positions.

use super::position::Position;
use crate::{Frame, View, Views};

const MAX_FRAMES: usize = 1 + View::ALL.len();

/// The frames of a capture in the order in which they are taken, the centre first, and their positions.
///
/// Other arrangements need no plan: a [`Sequence`](super::Sequence) takes any positions, such as an array of
/// three by three.
///
/// ```
/// use multiscopic_core::{Frame, View, Views, capture::{Plan, Policy, Position, Sequence}};
/// let plan = Plan::cross(Views::HORIZONTAL, 20_000);
/// assert_eq!(plan.frames()[1], Frame::View(View::Left));
/// assert_eq!(plan.positions()[1], Position { x_um: -20_000, y_um: 0 });
///
/// let array: [Position; 9] =
///     core::array::from_fn(|i| Position { x_um: 10_000 * (i as i32 % 3 - 1), y_um: 10_000 * (i as i32 / 3 - 1) });
/// let sequence: Sequence<'_, (), ()> = Sequence::new(&array, Policy::default());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    frames: [Frame; MAX_FRAMES],
    positions: [Position; MAX_FRAMES],
    len: usize,
}

impl Plan {
    /// The centre and its neighbours, one baseline away. The baseline is in micrometres.
    pub fn cross(views: Views, baseline_um: u32) -> Plan {
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
