//! The comparison of `bench` with OpenCV on the same machine, measured by a program in Python.

use multiscopic::{
    Error, Method, Result,
    stereo::{CostFunction, Optimizer, optimization::sgm::Paths},
};
use multiscopic_core::Search;

/// The program, with names in braces for what differs.
const PROGRAM: &str = include_str!("opencv.py");

/// The call that makes OpenCV's matcher of the same kind, without its filters. OpenCV takes multiples of 16 disparities.
///
/// # Errors
/// If OpenCV has no such method.
pub fn matcher(method: &Method, num_disparities: usize) -> Result<String> {
    let count = num_disparities.next_multiple_of(16);
    match (&method.cost, &method.optimizer) {
        (CostFunction::Sad { block_size }, Optimizer::WinnerTakesAll) if *block_size >= 5 => {
            Ok(format!("cv2.StereoBM.create({count}, {block_size})"))
        }
        (CostFunction::Sad { .. }, Optimizer::WinnerTakesAll) => {
            Err(Error::Usage("OpenCV's StereoBM has blocks of at least 5 pixels: give --block-size".into()))
        }
        (_, Optimizer::SemiGlobal(sgm)) => {
            let mode = match sgm.paths {
                Paths::Four => "HH4",
                Paths::Five => "SGBM",
                Paths::Eight => "HH",
            };
            // OpenCV's example of penalties, for blocks of 5 x 5 pixels.
            Ok(format!("cv2.StereoSGBM.create(0, {count}, 5, 200, 800, -1, 63, 0, 0, 0, cv2.STEREO_SGBM_MODE_{mode})"))
        }
        _ => Err(Error::Usage("OpenCV has matchers like bm and sgm alone: give --method".into())),
    }
}

/// The program that measures a matcher on frames of a search's size, on a number of threads, and takes the best of some runs.
pub fn program(search: &Search, matcher: &str, [threads, repeat]: [usize; 2]) -> String {
    // OpenCV takes one thread per core if it is told -1, and none at all if 0.
    let threads = if threads == 0 { "-1".into() } else { threads.to_string() };
    let numbers = [("{width}", search.width()), ("{height}", search.height()), ("{repeat}", repeat)];
    let program = PROGRAM.replace("{matcher}", matcher).replace("{threads}", &threads);
    numbers.iter().fold(program, |program, (name, number)| program.replace(name, &number.to_string()))
}
