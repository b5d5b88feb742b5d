//! The command `live`.

use std::{fs, process::ExitCode, sync::Arc, thread};

use clap::Args;
use multiscopic::{Error, Result};

use super::{
    live_page::Page,
    live_source::{CameraOptions, LiveSource},
    serving::ServingOptions,
    studio::Studio,
    tuner,
    tuning::Workbench,
};
use crate::command::options::EngineOptions;

/// Serves a page with a camera on a stage: what it sees, whether it is in focus and well exposed, and the sets that it takes,
/// which are matched as on the page of `tune`
///
/// The page is served on the loopback address, to whoever has the address with its token: they can move the stage. Ctrl-C returns
/// the stage to the centre and ends the program; a second Ctrl-C stops the stage where it is.
#[derive(Debug, Args)]
pub struct Live {
    #[command(flatten)]
    source: LiveSource,

    #[command(flatten)]
    serving: ServingOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

impl Live {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        match &self.source {
            LiveSource::Rig(rig) => tuner::tune(rig, &self.serving, &self.engine),
            LiveSource::Camera(options) => self.show(options),
        }
    }

    fn show(&self, CameraOptions { recorder, output }: &CameraOptions) -> Result<ExitCode> {
        fs::create_dir_all(output).map_err(|source| Error::Write { path: output.clone(), source })?;
        let recorder = recorder.recorder()?;
        let page = Page { title: "Live", has_camera: true };
        let bench = Arc::new(Workbench::new(self.engine.engine()?));
        let studio = Arc::new(Studio::new(bench.clone(), output));
        let served = self.serving.bind()?;
        let shooting = {
            let studio = studio.clone();
            thread::spawn(move || studio.run(recorder))
        };
        let code = served.serve(page, &bench, studio.clone(), |signals| {
            studio.receive(signals);
            shooting.is_finished()
        });
        if let Err(panic) = shooting.join() {
            std::panic::resume_unwind(panic);
        }
        code
    }
}
