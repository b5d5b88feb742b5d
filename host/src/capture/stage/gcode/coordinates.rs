//! Positions as G-code machines write them.

use multiscopic_core::capture::Position;

use crate::capture::stage::limits::Limits;

/// Converts a position to the coordinates, in millimetres, of a machine that started at `start`.
pub fn to_machine(start: [f64; 2], position: Position) -> [f64; 2] {
    [start[0] + f64::from(position.x_um) / 1e3, start[1] - f64::from(position.y_um) / 1e3]
}

/// Converts the coordinates of a machine that started at `start` to a position.
pub fn to_position(start: [f64; 2], machine: [f64; 2]) -> Position {
    let um = |millimetres: f64| (millimetres * 1e3).round() as i32;
    Position { x_um: um(machine[0] - start[0]), y_um: um(start[1] - machine[1]) }
}

/// The G-code of a straight move.
pub fn linear_move(target: [f64; 2], limits: &Limits) -> String {
    // Adding 0 turns -0 into 0.
    let [x, y] = target.map(|millimetres| (millimetres * 1e4).round() / 1e4 + 0.0);
    format!("G1 X{x:.4} Y{y:.4} F{:.1}", limits.speed_mm_s * 60.0)
}

/// The Euclidean distance.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Parses a coordinate. `None` if the text is not a number, or not one that a machine can mean.
pub fn parse_coordinate(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| (-1e5..=1e5).contains(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn y_points_up() {
        let position = Position { x_um: 1500, y_um: 250 };
        assert_eq!(to_machine([10.0, 20.0], position), [11.5, 19.75]);
        assert_eq!(to_position([10.0, 20.0], [11.5, 19.75]), position);
        assert_eq!(linear_move([11.5, -0.00001], &Limits::default()), "G1 X11.5000 Y0.0000 F3000.0");
    }
}
