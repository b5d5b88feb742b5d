//! The main function of the firmware.

use defmt_semihosting as _; // Sends the log to the host's standard output.
use embedded_io::Write;
use multiscopic_core::{Fusion, Params};
use multiscopic_edge::{Board, Matching, Pipeline, PipelineError};
use semihosting::process;

use crate::{
    runtime,
    semihosted::{self, FirmwareError, Semihosted},
};

defmt::timestamp!("{=u64:ms}", semihosted::elapsed().as_millis() as u64);

/// The fusion rule of the profiles, which the environment of the build chooses: firmware links one.
pub const FUSION: Fusion = match option_env!("MULTISCOPIC_FUSION") {
    None => Fusion::Min,
    Some(name) => match fusion_of(name) {
        Some(fusion) => fusion,
        None => panic!("MULTISCOPIC_FUSION is none of min, mean, heuristic and half"),
    },
};

/// Matches the frames of the board, sends the disparities and exits.
pub fn run<P: Params<Matching>>(name: &str, matching: &P, pipeline: Pipeline<'_>) -> ! {
    match match_and_send(name, matching, pipeline) {
        Ok(()) => process::exit(0),
        Err(error) => runtime::fail(error),
    }
}

#[inline(always)]
fn match_and_send<P: Params<Matching>>(name: &str, matching: &P, pipeline: Pipeline<'_>) -> Result<(), FirmwareError> {
    let search = matching.get().search();
    defmt::info!("profile {=str}, {=usize} columns at a time, {}", name, matching.get().tile_width(), search);
    let first = Semihosted.frames(search)?;
    let mut output = Semihosted.output()?;
    let run = match matching.get().long_search() {
        Some(long) => pipeline.run::<Semihosted, P>(matching, &mut [first, Semihosted.frames(long)?], &mut output),
        None => pipeline.run::<Semihosted, P>(matching, &mut [first], &mut output),
    };
    let mut sender = run.map_err(FirmwareError::Pipeline)?;
    let stack = runtime::stack_depth();
    output
        .write_all(sender.end(Some(stack)).map_err(FirmwareError::Packet)?)
        .map_err(|error| FirmwareError::Pipeline(PipelineError::Write(error)))?;
    defmt::info!("done after {=u64} ms, {=usize} bytes of stack", Semihosted.elapsed().as_millis() as u64, stack);
    Ok(())
}

const fn fusion_of(name: &str) -> Option<Fusion> {
    match name.as_bytes() {
        b"min" => Some(Fusion::Min),
        b"mean" => Some(Fusion::Mean),
        b"heuristic" => Some(Fusion::Heuristic),
        b"half" => Some(Fusion::Half),
        _ => None,
    }
}
