//! The firmware on a Cortex-M processor.

mod fault;
mod host_file;
mod phase;
mod semihosted;

use core::{ffi::CStr, fmt};
use cortex_m as _; // brings the critical section
use defmt_semihosting as _; // takes the log to the host's standard output
use embedded_io::Write;
use multiscopic_core::{Fusion, Params, Views};
use semihosting::{experimental::env, process};

use crate::{Board, Pipeline, PipelineError, Profile, StreamsError, packet::BufferTooSmall};

pub use fault::fail;
pub use host_file::{HostError, HostFile};
use semihosted::Semihosted;

defmt::timestamp!("{=u64:ms}", semihosted::elapsed().as_millis() as u64);

/// The room for the words that the firmware is started with.
const ARGS: usize = 256;

/// Matches the frames of the board in the way that `profile` says, with the rule of fusion that is its only argument.
pub fn run(profile: &Profile, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = profile.params(chosen_fusion()?);
        matched(&mut Semihosted, profile.name, &params, profile.tile_width(), pipeline)
    })
}

/// Matches the frames of the board in the way that its arguments say, in any workspace that is large enough: width, height, number of
/// views (1 to 4), smallest disparity, number of disparities, block size, rule of fusion, and columns of a tile.
pub fn calibrate(pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let (params, tile_width) = calibration().ok_or(Failure::Calibration)?;
        matched(&mut Semihosted, "calibration", &params, tile_width, pipeline)
    })
}

fn end(work: impl FnOnce() -> Result<(), Failure>) -> ! {
    match work() {
        Ok(()) => process::exit(0),
        Err(failure) => fault::fail(failure),
    }
}

fn matched(
    board: &mut Semihosted,
    name: &str,
    params: &Params,
    tile_width: usize,
    pipeline: Pipeline<'_>,
) -> Result<(), Failure> {
    defmt::info!("profile {=str}, {=usize} columns at a time, {}", name, tile_width, params);
    let (mut frames, mut output) = (board.frames(params)?, board.output()?);
    let run = pipeline.run::<Semihosted>(params, tile_width, &mut frames, &mut output);
    let mut sender = run.map_err(Failure::Pipeline)?;
    let stack = cortex_m_stack::stack_size() as usize - cortex_m_stack::stack_painted() as usize;
    output
        .write_all(sender.end(Some(stack)).map_err(Failure::Packet)?)
        .map_err(|error| Failure::Pipeline(PipelineError::Write(error)))?;
    defmt::info!("done after {=u64} ms, {=usize} bytes of stack", board.elapsed().as_millis() as u64, stack);
    Ok(())
}

/// The words that the firmware is started with; the first is its name.
fn args() -> Result<env::Args<ARGS>, Failure> {
    env::args::<ARGS>().map_err(|error| Failure::Args(HostError(error)))
}

/// The rule of fusion that the firmware of a profile is started with. The words do not stay on the stack.
#[inline(never)]
fn chosen_fusion() -> Result<Fusion, Failure> {
    let args = args()?;
    (&args).nth(1).and_then(Result::ok).and_then(fusion).ok_or(Failure::Fusion)
}

/// The rule of fusion of that name.
fn fusion(name: &str) -> Option<Fusion> {
    Fusion::ALL.into_iter().find(|fusion| fusion.name() == name)
}

/// What a calibration is started with, if it is that.
#[inline(never)]
fn calibration() -> Option<(Params, usize)> {
    let args = args().ok()?;
    let mut words = (&args).into_iter().skip(1).map_while(Result::ok);
    let (width, height) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let views = match words.next()? {
        "1" => Views::STEREO,
        "2" => Views::HORIZONTAL,
        "3" => Views::THREE,
        "4" => Views::ALL,
        _ => return None,
    };
    let (min_disparity, num_disparities) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let block_size = words.next()?.parse().ok()?;
    let params = Params::new(width, height, views, fusion(words.next()?)?, min_disparity, num_disparities, block_size);
    Some((params.ok()?, words.next()?.parse().ok()?))
}

/// Why the firmware did not come to its end.
enum Failure {
    /// The words that it was started with could not be had.
    Args(HostError),
    /// The argument is no rule of fusion.
    Fusion,
    /// The arguments are not those of a calibration.
    Calibration,
    /// A file could not be opened.
    File(&'static CStr, HostError),
    /// A frame has another size.
    Size {
        /// Its file.
        path: &'static CStr,
        /// Bytes it has.
        found: u64,
        /// Bytes that it should have.
        expected: u64,
    },
    /// A line could not be read, matched or sent.
    Pipeline(PipelineError<StreamsError<HostError>, HostError>),
    /// The last packet could not be encoded.
    Packet(BufferTooSmall),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |path: &'static CStr| path.to_str().unwrap_or("a file");
        match self {
            Failure::Args(error) => write!(f, "the words that it was started with cannot be had: {error}"),
            Failure::Fusion => write!(f, "start it with one word: min, mean or heuristic"),
            Failure::Calibration => write!(
                f,
                "start it with: width, height, views (1 to 4), smallest disparity, disparities, block size, fusion, columns of a tile"
            ),
            Failure::File(path, error) => write!(f, "cannot open {}: {error}", name(path)),
            Failure::Size { path, found, expected } => {
                write!(f, "{} has {found} bytes, a frame of this profile has {expected}", name(path))
            }
            Failure::Pipeline(error) => write!(f, "{error}"),
            Failure::Packet(error) => write!(f, "{error}"),
        }
    }
}
