//! The main functions of the firmware.

use defmt_semihosting as _; // Sends the log to the host's standard output.
use embedded_io::Write;
use multiscopic_core::{Frame, Fusion, Params, SweepOffset, View, Views};
use multiscopic_edge::{
    Board, Matching, Pipeline, PipelineError, Streams, SweepPipeline, frame_file::FrameFile, profile::Profile,
};
use semihosting::process;

use crate::{
    runtime,
    semihosted::{self, FirmwareError, HostFile, Semihosted},
};

defmt::timestamp!("{=u64:ms}", semihosted::elapsed().as_millis() as u64);

/// The fusion rule of a profile: that of the environment of the build, or else the profile's default. Firmware links one.
pub const fn fusion(profile: &Profile) -> Fusion {
    match option_env!("MULTISCOPIC_FUSION") {
        None => profile.default_fusion(),
        Some(name) => match fusion_of(name) {
            Some(fusion) => fusion,
            None => panic!("MULTISCOPIC_FUSION is none of min, mean, heuristic, half and trimmed"),
        },
    }
}

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

/// The steps of a sweep to each side. As many are the unit baseline.
const STEPS: i8 = 16;

/// Refines the disparities of a sweep with the frames of the steps to both sides, nearest first, sends a map after each `every` frames,
/// and exits.
pub fn sweep(mut pipeline: SweepPipeline<'_>, every: usize) -> ! {
    match refine_and_send(&mut pipeline, every) {
        Ok(()) => process::exit(0),
        Err(error) => runtime::fail(error),
    }
}

#[inline(always)]
fn refine_and_send(pipeline: &mut SweepPipeline<'_>, every: usize) -> Result<(), FirmwareError> {
    let (mut center, mut output) = (open(Frame::Center)?, Semihosted.output()?);
    for (frames, step) in (1_usize..).zip((1..=STEPS).flat_map(|step| [step, -step])) {
        let bits = i32::from(step) * SweepOffset::STEPS / i32::from(STEPS);
        let (Some(offset), Ok(view)) = (SweepOffset::from_bits(bits), View::new(step, 0)) else { continue };
        let mut frame = open(Frame::View(view))?;
        pipeline.refine::<Semihosted>(offset, &mut center, &mut frame).map_err(FirmwareError::Pipeline)?;
        if !frames.is_multiple_of(every) {
            continue;
        }
        let mut sender = pipeline.send::<Semihosted>(&mut center, &mut output).map_err(FirmwareError::Pipeline)?;
        let end = sender.end(Some(runtime::stack_depth())).map_err(FirmwareError::Packet)?;
        output.write_all(end).map_err(|error| FirmwareError::Pipeline(PipelineError::Write(error)))?;
    }
    Ok(())
}

/// A frame alone.
fn open(frame: Frame) -> Result<Streams<HostFile>, FirmwareError> {
    Streams::open(Views::NONE, |_| HostFile::open(FrameFile::new(frame).name()))
        .map_err(|error| FirmwareError::Frame(frame, error))
}

const fn fusion_of(name: &str) -> Option<Fusion> {
    match name.as_bytes() {
        b"min" => Some(Fusion::Min),
        b"mean" => Some(Fusion::Mean),
        b"heuristic" => Some(Fusion::Heuristic),
        b"half" => Some(Fusion::Half),
        b"trimmed" => Some(Fusion::Trimmed),
        _ => None,
    }
}
