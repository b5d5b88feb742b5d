//! Orders to a stage that talks to a liar.

use multiscopic_core::capture::Position;
use proptest::prelude::*;

/// An order to a stage.
#[derive(Clone, Debug)]
pub enum Order {
    MoveTo(Position),
    HasArrived,
    Position,
    Stop,
    /// Nothing for some milliseconds.
    Wait(u64),
}

/// Positions near the centre, within a reach of 50 mm, beyond it, and far off.
fn position() -> impl Strategy<Value = Position> {
    let coordinate = || prop_oneof![4 => -60_000..60_000, 4 => -500..500, 1 => any::<i32>()];
    (coordinate(), coordinate()).prop_map(|(x_um, y_um)| Position { x_um, y_um })
}

/// Any order, moves and questions for arrival more often than others.
pub fn order() -> impl Strategy<Value = Order> {
    prop_oneof![
        4 => position().prop_map(Order::MoveTo),
        4 => Just(Order::HasArrived),
        1 => Just(Order::Position),
        1 => Just(Order::Stop),
        2 => (0..30_u64).prop_map(Order::Wait),
    ]
}
