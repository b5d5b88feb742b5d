//! The Python package `multiscopic`: multiscopic matching of numpy arrays, with the bits of the program.
//!
//! Doc comments of what Python sees are written for `help()`.
//!
//! | module | what it is |
//! | --- | --- |
//! | `interpreter` | errors as Python's exceptions, and long work that leaves the interpreter to other threads |
//! | `arrays` | numpy arrays as pictures and maps, and back |
//! | `files` | reading and writing the program's files |
//! | `options` | the keyword arguments of matching |
//! | `match_result` | the result of matching, the camera that depths follow from, and error metrics of disparities |
//! | `capture` | the images of one capture, from arrays or a captured folder, and matching of them |
//! | `own_hardware` | captures by stages and cameras that are Python's objects |
//! | `views` | matching, rectification and inspection of arrays |
//! | `multiscopic` | the module that Python imports |

mod arrays;
mod capture;
mod files;
mod interpreter;
mod match_result;
mod options;
mod own_hardware;
mod views;

/// Accurate depth from one camera that is moved on purpose: multiscopic matching of numpy arrays.
///
/// match() estimates the disparity of each pixel of a centre image by matching it with its neighbours, and match_sweep() from the
/// frames of a camera that slides. Rig.load() reads
/// captured folders, and capture() makes them with a stage and a camera of your own. evaluate() measures errors.
#[pyo3::pymodule]
mod multiscopic {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::{
        capture::Rig,
        files::{colorize, read_image, read_pfm, set_max_pixels, write_pfm, write_png},
        interpreter::MatchWarning,
        match_result::{MatchResult, evaluate},
        own_hardware::capture,
        views::{align, inspect, match_sweep},
    };

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "it is Python's name")]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::views::add_match(module)
    }
}
