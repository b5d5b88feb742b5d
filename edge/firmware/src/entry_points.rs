//! The main functions of the firmware.

use cortex_m as _; // Provides the critical section.
use defmt_semihosting as _; // Sends the log to the host's standard output.
use embedded_io::Write;
use multiscopic_core::Params;
use multiscopic_edge::{Board, Pipeline, PipelineError, Profile};
use semihosting::process;

use crate::{
    arguments,
    board_kernel::BoardKernel,
    error::FirmwareError,
    fault,
    semihosted::{self, Semihosted},
};

defmt::timestamp!("{=u64:ms}", semihosted::elapsed().as_millis() as u64);

/// Matches the frames of the board with the parameters of `profile` and the fusion on the command line.
pub fn run(profile: &Profile, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = profile.params(arguments::fusion()?);
        match_frames(&mut Semihosted, profile.name, &params, profile.tile_width(), pipeline)
    })
}

/// Matches the frames of the board with the parameters on the command line, if the workspace is large enough.
pub fn calibrate(pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let (params, tile_width) = arguments::calibration().ok_or(FirmwareError::Calibration)?;
        match_frames(&mut Semihosted, "calibration", &params, tile_width, pipeline)
    })
}

/// Does `work` and exits.
fn end(work: impl FnOnce() -> Result<(), FirmwareError>) -> ! {
    match work() {
        Ok(()) => process::exit(0),
        Err(error) => fault::fail(error),
    }
}

fn match_frames(
    board: &mut Semihosted,
    name: &str,
    params: &Params,
    tile_width: usize,
    pipeline: Pipeline<'_>,
) -> Result<(), FirmwareError> {
    defmt::info!("profile {=str}, {=usize} columns at a time, {}", name, tile_width, params);
    let (mut frames, mut output) = (board.frames(params)?, board.output()?);
    let kernel = BoardKernel::default();
    let run = pipeline.run::<Semihosted, _>(kernel, params, tile_width, &mut frames, &mut output);
    let mut sender = run.map_err(FirmwareError::Pipeline)?;
    let stack = cortex_m_stack::stack_size() as usize - cortex_m_stack::stack_painted() as usize;
    output
        .write_all(sender.end(Some(stack)).map_err(FirmwareError::Packet)?)
        .map_err(|error| FirmwareError::Pipeline(PipelineError::Write(error)))?;
    defmt::info!("done after {=u64} ms, {=usize} bytes of stack", board.elapsed().as_millis() as u64, stack);
    Ok(())
}
