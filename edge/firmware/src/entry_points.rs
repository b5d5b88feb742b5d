//! The main functions of the firmware, and the command line that it is started with.

use defmt_semihosting as _; // Sends the log to the host's standard output.
use embedded_io::Write;
use multiscopic_core::{
    BlockMatchingParams, Fusion, SearchConfig, SearchSpace, SemiGlobalCost, SemiGlobalParams, Views, network::NetworkParams,
};
use multiscopic_edge::{Board, Matching, Pipeline, PipelineError, RunError, Streams, packet::Sender};
use semihosting::{experimental::env, process};

use crate::{
    board_kernel::BoardKernel,
    runtime,
    semihosted::{self, FirmwareError, HostError, HostFile, Semihosted},
};

/// The most bytes of a command line.
const COMMAND_LINE_BYTES: usize = 256;

defmt::timestamp!("{=u64:ms}", semihosted::elapsed().as_millis() as u64);

/// Matches blocks of the frames of the board, with the fusion on the command line.
// Inlined, as all below, so that the compiler knows the parameters.
#[inline(always)]
pub fn match_blocks(name: &str, params: BlockMatchingParams, tile_width: usize, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(fusion()?);
        let mut frames = open(name, tile_width, params.search())?;
        send(|output| pipeline.match_blocks::<Semihosted, _>(BoardKernel::default(), &params, tile_width, &mut frames, output))
    })
}

/// Matches the frames of the board semi-globally, with the fusion on the command line.
#[inline(always)]
pub fn match_semi_globally(name: &str, params: SemiGlobalParams, pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let params = params.with_fusion(fusion()?);
        let mut frames = open(name, params.search().width(), params.search())?;
        send(|output| pipeline.match_semi_globally::<Semihosted, _>(BoardKernel::default(), &params, &mut frames, output))
    })
}

/// Matches the frames of the board from short baselines to long ones, with the fusion on the command line.
#[inline(always)]
pub fn match_around_prior(name: &str, (short, long): (BlockMatchingParams, BlockMatchingParams), pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let fusion = fusion()?;
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
        let params = params.with_fusion(fusion()?);
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
        let params = params.with_fusion(fusion()?);
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
        let params = params.with_fusion(fusion()?);
        let mut frames = open(name, params.search().width(), params.search())?;
        send(|output| pipeline.match_by_network::<Semihosted, _>(BoardKernel::default(), &params, &mut frames, output))
    })
}

/// Matches the frames of the board with the parameters on the command line, if the workspace is large enough.
pub fn calibrate(pipeline: Pipeline<'_>) -> ! {
    end(|| {
        let matching = calibration().ok_or(FirmwareError::Calibration)?;
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
        Err(error) => runtime::fail(error),
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

/// The fusion that is the only argument.
///
/// Not inlined, so that the command line leaves the stack before matching begins.
#[inline(never)]
fn fusion() -> Result<Fusion, FirmwareError> {
    let words = words()?;
    (&words).nth(1).and_then(Result::ok).and_then(fusion_of).ok_or(FirmwareError::Fusion)
}

/// The computation of a calibration.
///
/// The arguments are width, height, number of views (1 to 4, or 8), smallest disparity, number of disparities,
/// block size, fusion, columns of a tile, and the method: `bm`, `sgm` with sums of absolute differences,
/// or `bm-around` with the long baseline in short ones and the number of disparities there.
///
/// Not inlined, like [`fusion`].
#[inline(never)]
fn calibration() -> Option<Matching> {
    let words = words().ok()?;
    let mut words = (&words).into_iter().skip(1).map_while(Result::ok);
    let (width, height) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let views = match words.next()? {
        "1" => Views::STEREO,
        "2" => Views::HORIZONTAL,
        "3" => Views::THREE,
        "4" => Views::CROSS,
        "8" => Views::ARRAY,
        _ => return None,
    };
    let (min_disparity, num_disparities) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    let block_size = words.next()?.parse().ok()?;
    let search = SearchConfig { width, height, views, fusion: fusion_of(words.next()?)?, min_disparity, num_disparities }
        .checked()
        .ok()?;
    let tile_width = words.next()?.parse().ok()?;
    let blocks = || BlockMatchingParams::block_matching(search, block_size).ok();
    Some(match words.next()? {
        "bm" => Matching::Blocks { params: blocks()?, tile_width },
        "sgm" => Matching::SemiGlobal(SemiGlobalParams::new(search, SemiGlobalCost::Sad { block_size }).ok()?),
        "bm-around" => {
            let multiple = words.next()?.parse().ok()?;
            Matching::around_prior(blocks()?, multiple, words.next()?.parse().ok()?)?
        }
        _ => return None,
    })
}

/// The words of the command line. The first is the name of the program.
fn words() -> Result<env::Args<COMMAND_LINE_BYTES>, FirmwareError> {
    env::args::<COMMAND_LINE_BYTES>().map_err(|error| FirmwareError::CommandLine(HostError(error)))
}

fn fusion_of(name: &str) -> Option<Fusion> {
    Fusion::ALL.into_iter().find(|fusion| fusion.name() == name)
}
