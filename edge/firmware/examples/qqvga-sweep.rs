//! Refines the disparities of the sweep `QQVGA_SWEEP` with 32 frames, and sends them after each pair of both sides as packets.
//!
//! The frames are files: `center.gray`, and those of the steps to both sides, nearest first, such as `right.gray` and `-16,0.gray`.
//! Sixteen steps are the unit baseline. `cargo xtask edge --profile qqvga-sweep` renders them, and compares the packets with the
//! host's.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use embedded_io::Write;
    use multiscopic_core::{Frame, SweepOffset, View, Views};
    use multiscopic_edge::{
        Board, Streams, SweepPipeline, Workspace, frame_file::FrameFile, packet, profile::QQVGA_SWEEP as PARAMS,
    };
    use multiscopic_firmware::{HostError, HostFile, Semihosted, entry, fail};
    use semihosting::process;
    use static_cell::ConstStaticCell;

    const STEPS: i8 = 16;
    const COLUMNS: usize = PARAMS.search().width();
    type Memory = Workspace<{ SweepPipeline::words(&PARAMS) }, COLUMNS, { packet::buffer_bytes_with_confidences(COLUMNS) }>;
    // With the stack and what firmware has besides.
    const _: () = assert!(size_of::<Memory>() <= 196 * 1024, "more than its 200 KiB");

    static MEMORY: ConstStaticCell<Memory> = ConstStaticCell::new(Memory::new());

    fn open(frame: Frame) -> Streams<HostFile> {
        let file: Result<_, HostError> = Streams::open(Views::NONE, |_| HostFile::open(FrameFile::new(frame).name()));
        file.unwrap_or_else(|error| fail(error))
    }

    #[entry]
    fn main() -> ! {
        let mut pipeline = MEMORY.take().sweep(&PARAMS).unwrap_or_else(|error| fail(error));
        let (mut center, mut output) = (open(Frame::Center), Semihosted.output().unwrap_or_else(|error| fail(error)));
        for step in (1..=STEPS).flat_map(|step| [step, -step]) {
            let bits = i32::from(step) * SweepOffset::STEPS / i32::from(STEPS);
            let (Some(offset), Ok(view)) = (SweepOffset::from_bits(bits), View::new(step, 0)) else { continue };
            let mut frame = open(Frame::View(view));
            if let Err(error) = pipeline.refine::<Semihosted>(offset, &mut center, &mut frame) {
                fail(error);
            }
            if step > 0 {
                continue;
            }
            let sent = pipeline.send::<Semihosted>(&mut center, &mut output);
            let mut sender = sent.unwrap_or_else(|error| fail(error));
            let end = sender.end(Some(multiscopic_firmware::stack_depth())).unwrap_or_else(|error| fail(error));
            output.write_all(end).unwrap_or_else(|error| fail(error));
        }
        process::exit(0)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
