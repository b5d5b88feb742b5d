//! The confidence of a disparity, by definition.

/// The grade of a peak ratio from 0 to 255: octaves of which each has two grades.
pub fn grade(ratio: f64) -> u8 {
    const BEGINS: [f64; 16] = [0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0, 96.0, 128.0, 192.0];
    BEGINS.iter().filter(|begin| **begin <= ratio).count() as u8 - 1
}

/// The confidence at `(u, v)` of a `map`, invalid where it has no disparity, with evidence from 0 to 15, by a `table` of
/// probabilities for each number of pixels that agree, from 1 on, and each evidence.
pub fn confidence(map: &[Vec<Option<f32>>], evidence: u8, table: &[[u8; 16]; 27], (u, v): (usize, usize)) -> u8 {
    let (width, height) = (map[0].len() as i32, map.len() as i32);
    let Some(own) = map[v][u] else { return 0 };
    let mut agreement = 0;
    for y in [-5, 0, 5] {
        for x in [-20, -15, -10, -5, 0, 5, 10, 15, 20] {
            let (x, y) = ((u as i32 + x).clamp(0, width - 1), (v as i32 + y).clamp(0, height - 1));
            let other = map[y as usize][x as usize];
            agreement += usize::from(other.is_some_and(|other| (other - own).abs() <= 1.0));
        }
    }
    table[agreement - 1][usize::from(evidence)]
}
