//! Multiscopic matching on a microcontroller: scanlines in, packets of disparities out.
//!
//! ```
//! use embedded_io::Write;
//! use multiscopic_core::{Fusion, params};
//! use multiscopic_edge::{Board, Matching, profile::QQVGA, workspace};
//!
//! // 160x120 pixels with two neighbours, whose code alone is linked.
//! params!(Qqvga: Matching = Ok(QQVGA.matching(Fusion::Min)));
//!
//! /// Matches the frames of a board and sends the disparities. In firmware, the memory is a static.
//! fn match_and_send<B: Board>(board: &mut B, memory: &mut workspace!(QQVGA)) -> Option<()> {
//!     let (frames, mut output) = (board.frames(Qqvga::PARAMS.search()).ok()?, board.output().ok()?);
//!     let mut sender = memory.pipeline().run::<B, _>(&Qqvga, &mut [frames], &mut output).ok()?;
//!     output.write_all(sender.end(None).ok()?).ok() // the packet that ends the frame
//! }
//! ```
//!
//! Implement [`Board`] for your hardware: its documentation has a complete program. [`Profile`] has ready-made sizes, and
//! [`Matching`] takes your own. On a host, `multiscopic listen` turns the packets into pictures, [`packet`] decodes them, and
//! `multiscopic simulate` runs the same pipeline, byte for byte.
//!
//! The crate is portable. Data flows down this table, and no module uses one below it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `board` | the hardware that a pipeline needs: [`Board`] |
//! | `streams` | scanlines from byte streams: [`Streams`] |
//! | `awaited_lines` | lines that are awaited, with the feature `async`: `AwaitedLines` |
//! | [`frame_file`] | the names of the files of frames and packets |
//! | [`packet`] | the packets that carry disparities to a host |
//! | `matching` | the computation of a pipeline and its memory: [`Matching`], [`Workspace`], [`Lengths`] |
//! | [`profile`] | ready-made match sizes and their RAM budgets: [`Profile`], [`SweepProfile`] |
//! | `pipeline` | matches the frames of a board and sends the disparities: [`Pipeline`], [`SweepPipeline`] |
#![no_std]

#[cfg(feature = "async")]
mod awaited_lines;
mod board;
pub mod frame_file;
mod matching;
pub mod packet;
mod pipeline;
pub mod profile;
mod streams;

#[cfg(feature = "async")]
pub use awaited_lines::{AsyncScanlineSource, AwaitedLineError, AwaitedLines};
pub use board::{Board, Phase};
pub use matching::{Lengths, Matching, WholeLines, Workspace, state_pointers};
pub use pipeline::{Pipeline, PipelineError, RunError, SweepPipeline};
pub use profile::{Profile, SweepProfile};
pub use streams::{Streams, StreamsError};
