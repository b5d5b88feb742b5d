//! The options of matching, described once: the command line, the keyword arguments of Python and the controls of the page in the
//! browser all follow from the structs of this crate.
//!
//! ```
//! use multiscopic::{Engine, Frames, Method};
//! use multiscopic_core::View;
//! use multiscopic_options::MatchingOptions;
//!
//! # fn main() -> multiscopic::Result<()> {
//! # let image = image::GrayImage::from_fn(40, 30, |u, v| [(u * 37 + v * 91) as u8].into());
//! # let (center, right) = (image.clone(), image);
//! let frames = Frames::new(center).with(View::RIGHT, right);
//! let options = MatchingOptions::parse(["--method", "sgm", "--min-disparity", "0", "--num-disparities", "16"])?;
//! let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
//! let disparities = options.method(frames.views())?.disparities(&Engine::new(None, 0)?, &frames, &search, &())?;
//! # assert_eq!((disparities.width(), disparities.height()), (40, 30));
//! # Ok(())
//! # }
//! ```
//!
//! To add an option, add a field to the struct of its group. The doc comment is the text of `--help` and of Python's `help()`,
//! the type decides what Python takes. In the same file, say what the option changes, and add a line to the group's table of the
//! page if it should have a control there.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`value`] | numbers, checked as they are parsed, and [`Named`]: values that are chosen by name |
//! | `page_entry` | the controls that options get on the page |
//! | `search` | the search range, the block, views at several baselines, and the preparation of images |
//! | `methods` | the options of `gc`, of `sgm`, and of `mccnn-fast` and `mccnn-accurate` |
//! | `refinement` | checks and filters of disparities |
//! | `matching` | all of them, and the method that they describe |
//! | [`page`] | the controls of the page in the browser |
//! | `machine` | threads, vector instructions and memory |
//! | [`keywords`] | the keyword arguments of Python |

pub mod keywords;
mod machine;
mod matching;
mod methods;
pub mod page;
mod page_entry;
mod refinement;
mod search;
pub mod value;

pub use keywords::Keywords;
pub use machine::{EngineOptions, MemoryOptions};
pub use matching::{MatchingOptions, MethodOptions, PRIOR_EXCLUDES};
pub use search::{BaselineOptions, BitsOption, PreparationOptions, SearchOptions, views_of_count};
pub use value::{Named, named};
