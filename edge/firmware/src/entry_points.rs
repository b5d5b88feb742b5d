//! The main functions of the firmware.

use cortex_m as _; // Provides the critical section.
use defmt_semihosting as _; // Sends the log to the host's standard output.
use embedded_io::Write;
use multiscopic_core::{Params, Search, SemiGlobalParams};
use multiscopic_edge::{Board, Pipeline, PipelineError, RunError, Streams, packet::Sender};
use semihosting::process;

use crate::{
    arguments,
    board_kernel::BoardKernel,
    error::FirmwareError,
    fault,
    host_file::HostFile,
    semihosted::{self, Semihosted},
};

defmt::timestamp!("{=u64:ms}", semihosted::elapsed().as_millis() as u64);

/// Matches blocks of the frames of the board, with the fusion on the command line.
// Inlined, as all below, so that the compiler knows the parameters.
#[inline(always)]
pub fn match_blocks(name: &str, params: Params, tile_width: usize, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(arguments::fusion()?);
        match_frames(&mut Semihosted, name, tile_width, params.search(), |frames, output| {
            pipeline.match_blocks::<Semihosted, _>(BoardKernel::default(), &params, tile_width, frames, output)
        })
    })
}

/// Matches the frames of the board semi-globally, with the fusion on the command line.
#[inline(always)]
pub fn match_semi_globally(name: &str, params: SemiGlobalParams, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(arguments::fusion()?);
        match_frames(&mut Semihosted, name, params.search().width(), params.search(), |frames, output| {
            pipeline.match_semi_globally::<Semihosted, _>(BoardKernel::default(), &params, frames, output)
        })
    })
}

/// Matches the frames of the board with the parameters on the command line, if the workspace is large enough.
pub fn calibrate(pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let matching = arguments::calibration().ok_or(FirmwareError::Calibration)?;
        match_frames(&mut Semihosted, "calibration", matching.tile_width(), matching.search(), |frames, output| {
            pipeline.run::<Semihosted, _>(BoardKernel::default(), &matching, frames, output)
        })
    })
}

/// Does `work` and exits.
#[inline(always)]
fn end(work: impl FnOnce() -> Result<(), FirmwareError>) -> ! {
    match work() {
        Ok(()) => process::exit(0),
        Err(error) => fault::fail(error),
    }
}

/// Runs a pipeline with the frames and the output of the board.
#[inline(always)]
fn match_frames<'w>(
    board: &mut Semihosted,
    name: &str,
    tile_width: usize,
    search: &Search,
    run: impl FnOnce(&mut Streams<HostFile>, &mut HostFile) -> Result<Sender<'w>, RunError<Semihosted>>,
) -> Result<(), FirmwareError> {
    defmt::info!("profile {=str}, {=usize} columns at a time, {}", name, tile_width, search);
    let (mut frames, mut output) = (board.frames(search)?, board.output()?);
    let mut sender = run(&mut frames, &mut output).map_err(FirmwareError::Pipeline)?;
    let stack = cortex_m_stack::stack_size() as usize - cortex_m_stack::stack_painted() as usize;
    output
        .write_all(sender.end(Some(stack)).map_err(FirmwareError::Packet)?)
        .map_err(|error| FirmwareError::Pipeline(PipelineError::Write(error)))?;
    defmt::info!("done after {=u64} ms, {=usize} bytes of stack", board.elapsed().as_millis() as u64, stack);
    Ok(())
}
