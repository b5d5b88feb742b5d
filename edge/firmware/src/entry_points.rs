//! The main functions of the firmware.

use defmt_semihosting as _; // Sends the log to the host's standard output.
use embedded_io::Write;
use multiscopic_core::{BlockMatchingParams, SearchSpace, SemiGlobalParams, network::NetworkParams};
use multiscopic_edge::{Board, Pipeline, PipelineError, RunError, Streams, packet::Sender};
use semihosting::process;

use crate::{
    arguments,
    board_kernel::BoardKernel,
    fault::{self, FirmwareError},
    host_file::HostFile,
    runtime,
    semihosted::{self, Semihosted},
};

defmt::timestamp!("{=u64:ms}", semihosted::elapsed().as_millis() as u64);

/// Matches blocks of the frames of the board, with the fusion on the command line.
// Inlined, as all below, so that the compiler knows the parameters.
#[inline(always)]
pub fn match_blocks(name: &str, params: BlockMatchingParams, tile_width: usize, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(arguments::fusion()?);
        let mut frames = open(name, tile_width, params.search())?;
        send(|output| pipeline.match_blocks::<Semihosted, _>(BoardKernel::default(), &params, tile_width, &mut frames, output))
    })
}

/// Matches the frames of the board semi-globally, with the fusion on the command line.
#[inline(always)]
pub fn match_semi_globally(name: &str, params: SemiGlobalParams, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(arguments::fusion()?);
        let mut frames = open(name, params.search().width(), params.search())?;
        send(|output| pipeline.match_semi_globally::<Semihosted, _>(BoardKernel::default(), &params, &mut frames, output))
    })
}

/// Matches the frames of the board from short baselines to long ones, with the fusion on the command line.
#[inline(always)]
pub fn match_around_prior(name: &str, (short, long): (BlockMatchingParams, BlockMatchingParams), pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let fusion = arguments::fusion()?;
        let (short, long) = (short.with_fusion(fusion), long.with_fusion(fusion));
        let mut short_frames = open(name, short.width(), short.search())?;
        let mut long_frames = open(name, long.width(), long.search())?;
        send(|output| {
            let frames = [&mut short_frames, &mut long_frames];
            pipeline.match_around_prior::<Semihosted, _>(BoardKernel::default(), (&short, &long), frames, output)
        })
    })
}

/// Matches blocks of the frames of the board and computes confidences, with the fusion on the command line.
#[inline(always)]
pub fn match_blocks_with_confidences(name: &str, params: BlockMatchingParams, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(arguments::fusion()?);
        let mut frames = open(name, params.width(), params.search())?;
        send(|output| {
            pipeline.match_blocks_with_confidences::<Semihosted, _>(BoardKernel::default(), &params, &mut frames, output)
        })
    })
}

/// Matches the frames of the board semi-globally and computes confidences, with the fusion on the command line.
#[inline(always)]
pub fn match_semi_globally_with_confidences(name: &str, params: SemiGlobalParams, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(arguments::fusion()?);
        let mut frames = open(name, params.search().width(), params.search())?;
        send(|output| {
            pipeline.match_semi_globally_with_confidences::<Semihosted, _>(BoardKernel::default(), &params, &mut frames, output)
        })
    })
}

/// Matches the frames of the board by the network, with the fusion on the command line.
#[inline(always)]
pub fn match_by_network(name: &str, params: NetworkParams, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(arguments::fusion()?);
        let mut frames = open(name, params.search().width(), params.search())?;
        send(|output| pipeline.match_by_network::<Semihosted, _>(BoardKernel::default(), &params, &mut frames, output))
    })
}

/// Matches the frames of the board with the parameters on the command line, if the workspace is large enough.
pub fn calibrate(pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let matching = arguments::calibration().ok_or(FirmwareError::Calibration)?;
        let long = matching.long_search().unwrap_or(matching.search());
        let mut frames = [open("calibration", matching.tile_width(), matching.search())?, Semihosted.frames(long)?];
        send(|output| pipeline.run_lines::<Semihosted, _>(BoardKernel::default(), &matching, &mut frames, output))
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

/// Opens the frames of a search.
#[inline(always)]
fn open(name: &str, tile_width: usize, search: &SearchSpace) -> Result<Streams<HostFile>, FirmwareError> {
    defmt::info!("profile {=str}, {=usize} columns at a time, {}", name, tile_width, search);
    Semihosted.frames(search)
}

/// Runs a pipeline with the output of the board.
#[inline(always)]
fn send<'w>(run: impl FnOnce(&mut HostFile) -> Result<Sender<'w>, RunError<Semihosted>>) -> Result<(), FirmwareError> {
    let mut output = Semihosted.output()?;
    let mut sender = run(&mut output).map_err(FirmwareError::Pipeline)?;
    let stack = runtime::stack_depth();
    output
        .write_all(sender.end(Some(stack)).map_err(FirmwareError::Packet)?)
        .map_err(|error| FirmwareError::Pipeline(PipelineError::Write(error)))?;
    defmt::info!("done after {=u64} ms, {=usize} bytes of stack", Semihosted.elapsed().as_millis() as u64, stack);
    Ok(())
}
