//! `multiscopic align`: the misalignment of the views.

use std::{path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{
    Alignment, Error, Frames, Result, Rig,
    alignment::Residual,
    files::{FrameFiles, output},
};
use serde::Serialize;

use super::{
    options::{EngineOptions, SearchOptions, SourceOptions},
    terminal,
};

/// Estimates each view's shift across its baseline, relative baseline length and relative brightness
///
/// The shift is to the right for views in the centre's column, and downwards across the baseline for others. Shift and
/// brightness can be corrected: in a new folder with -o, or just before matching with `multiscopic match --align`.
#[derive(Clone, Debug, Args)]
pub struct Align {
    #[command(flatten)]
    source: SourceOptions,

    #[command(flatten)]
    search: SearchOptions,

    /// New folder for the capture with corrected shifts and brightness
    #[arg(short, long, value_name = "NEW_RIG_DIR")]
    output: Option<PathBuf>,

    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    engine: EngineOptions,
}

/// A line of the table; `--json` prints these fields.
#[derive(Debug, Serialize)]
struct Line {
    view: String,
    #[serde(flatten)]
    residual: Residual,
}

impl Align {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let Some((images, rig)) = self.source.frame_files()? else {
            let message = "there are no images to align: give RIG_DIR, a folder with a rig.toml, or --center and its neighbours";
            return Err(Error::Usage(message.into()));
        };
        if self.output.is_some() && rig.is_none() {
            let message = "-o writes a folder with a rig.toml, which only a captured folder can provide: give RIG_DIR";
            return Err(Error::Usage(message.into()));
        }
        let (frames, _) = Frames::load(&images)?;
        let search = self.search.search(frames.size(), frames.views(), None, SearchOptions::DEFAULT_RANGE)?;
        let params = self.search.params(search)?;
        let alignment = Alignment::estimate(&frames, &params, &self.engine.engine()?)?;
        let lines: Vec<Line> = frames
            .views()
            .iter()
            .filter_map(|view| Some(Line { view: view.to_string(), residual: alignment.of(view)? }))
            .collect();
        if let (Some(folder), Some(rig)) = (&self.output, rig) {
            let images = FrameFiles::of_capture(frames.views());
            let compensated = alignment.compensate(&frames);
            output::write_folder(folder, |folder| {
                compensated.save(&images.within(folder))?;
                Rig { images: images.clone(), ..rig }.save(folder)
            })?;
            terminal::say(&format!("wrote {}", folder.display()));
        }
        terminal::print(&match self.json {
            true => serde_json::to_string(&lines).expect("numbers and strings") + "\n",
            false => table(&lines),
        })?;
        Ok(ExitCode::SUCCESS)
    }
}

fn table(lines: &[Line]) -> String {
    let mut table = String::from("view    across px  baseline  at the nearest px  brightness  blocks\n");
    for Line { view, residual } in lines {
        let Residual { across_px, baseline_scale, baseline_px, gain, blocks } = residual;
        table += &format!("{view:<8}{across_px:>+9.2}{baseline_scale:>10.4}{baseline_px:>+19.2}{gain:>12.4}{blocks:>8}\n");
    }
    table
}
