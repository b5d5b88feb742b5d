//! `multiscopic capture`: a stage moves a camera, and the frames are written to a folder with a `rig.toml`.

mod capture_log;
#[cfg(feature = "mcap")]
mod live_recording;
mod long_baseline;
mod recorder;
mod recorder_options;

use std::{
    fs,
    num::NonZeroU32,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::atomic::Ordering,
};

use clap::Args;
use multiscopic::{Error, Result, files::output};

use super::{options::output_file, terminal, view::View};

pub use self::{recorder::Recorder, recorder_options::RecorderOptions};
#[cfg(feature = "mcap")]
use live_recording::LiveRecording;

/// Captures the frames of a rig: a stage moves a camera to the centre and to its neighbours
///
/// The folder appears once all frames are taken. When the command ends, for whatever reason, the stage stands still.
/// Ctrl-C returns it to the centre; a second Ctrl-C stops it where it is.
#[derive(Clone, Debug, Args)]
pub struct Capture {
    #[command(flatten)]
    recorder: RecorderOptions,

    /// Folder for the frames, rig.toml and capture.log; with --live it holds folders 0001, 0002, and so on
    #[arg(short, long, value_name = "RIG_DIR")]
    output: PathBuf,

    /// Capture repeatedly until Ctrl-C
    #[arg(long, conflicts_with = "accuracy")]
    live: bool,

    /// Page to look at the capture, matched by blocks, see `multiscopic view`
    #[arg(long, value_name = "FILE.html", conflicts_with = "live", value_parser = output_file::html)]
    report: Option<PathBuf>,

    /// Number of captures with --live [default: no limit]
    #[arg(long, value_name = "N", requires = "live")]
    count: Option<NonZeroU32>,

    /// With --live, a recording for ROS 2 and Foxglove, or a pipe: depth, disparities and the other topics of `match --mcap` of each
    /// capture, matched by blocks as soon as it is taken; needs the focal length
    #[cfg(feature = "mcap")]
    #[arg(long, value_name = "OUT.mcap", requires = "live", value_parser = output_file::mcap)]
    mcap: Option<PathBuf>,

    /// Print what was captured as a JSON object on standard output, one a line with --live
    #[arg(long)]
    json: bool,
}

impl Capture {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        if !self.live {
            output::check_folder(&self.output)?;
        }
        // A page in the folder can be written once the folder is there.
        if let Some(page) = self.report.as_deref().filter(|page| !page.starts_with(&self.output)) {
            output::check(&[page], &[])?;
        }
        let mut recorder = self.recorder.recorder()?;
        if self.live {
            self.run_live(&mut recorder)?;
        } else {
            self.record(&mut recorder, &self.output)?;
            if let Some(page) = &self.report {
                View::of_capture(&self.output, page, &self.recorder.search).run()?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }

    /// Takes a capture and reports it.
    fn record(&self, recorder: &mut Recorder, folder: &Path) -> Result<()> {
        let recorded = recorder.record(folder, &mut |_, _, _| ())?;
        if self.json { terminal::print_report(&recorded, true) } else { Ok(()) }
    }

    /// Records captures in numbered folders, and what is found of them, if that is asked for.
    fn run_live(&self, recorder: &mut Recorder) -> Result<()> {
        #[cfg(feature = "mcap")]
        if let Some(path) = &self.mcap {
            output::check(&[path], &[])?;
            let live = LiveRecording::new(recorder, &self.recorder.search)?;
            return live.write(path, |found| self.run_captures(recorder, found));
        }
        self.run_captures(recorder, &mut |_| Ok(()))
    }

    /// Records captures in numbered folders until there are enough or the user interrupts. `done` is told each folder.
    fn run_captures(&self, recorder: &mut Recorder, done: &mut dyn FnMut(&Path) -> Result<()>) -> Result<()> {
        fs::create_dir_all(&self.output).map_err(|source| Error::Write { path: self.output.clone(), source })?;
        let mut folders = free_folders(&self.output);
        for _ in 0..self.count.map_or(u32::MAX, NonZeroU32::get) {
            if recorder.hardware.interrupts.load(Ordering::Relaxed) > 0 {
                break;
            }
            let Some(folder) = folders.next() else {
                return Err(Error::Usage(format!("{} is full, give another folder", self.output.display())));
            };
            self.record(recorder, &folder)?;
            done(&folder)?;
        }
        Ok(())
    }
}

/// Folders 0001 to 9999 within `parent`, without those that exist.
pub fn free_folders(parent: &Path) -> impl Iterator<Item = PathBuf> {
    (1..=9999).map(move |number| parent.join(format!("{number:04}"))).filter(|folder| !folder.exists())
}
