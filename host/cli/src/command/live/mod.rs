//! `multiscopic tune` and `multiscopic live`: a page on which a rig is matched while the options of `match` are set, and a camera
//! takes further rigs.

mod frame_meters;
mod notice_board;
mod server;
mod serving;
mod studio;
mod tuned_rig;
mod workbench;

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
    thread,
};

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, Id, value_parser};
use multiscopic::{Error, Result};
use serde::Deserialize;

use self::{
    notice_board::NoticeBoard,
    server::Messages,
    serving::{Page, ServingOptions},
    studio::Studio,
    tuned_rig::TunedRig,
    workbench::{Wish, Workbench},
};
use crate::command::{capture::RecorderOptions, options::EngineOptions, view};

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
            LiveSource::Rig(rig) => tune(rig, &self.serving, &self.engine),
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

/// A camera on a stage, or a captured folder.
#[derive(Debug)]
pub enum LiveSource {
    /// `RIG_DIR`.
    Rig(PathBuf),
    /// `--camera` and what it needs.
    Camera(Box<CameraOptions>),
}

/// The camera, the stage, and the folder of the sets.
#[derive(Debug, Args)]
pub struct CameraOptions {
    #[command(flatten)]
    pub recorder: RecorderOptions,

    /// Folder for the sets, which become its folders 0001, 0002, and so on
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}

const RIG: &str = "rig";

/// The options of a camera are required unless there is a folder: clap does not derive that.
impl Args for LiveSource {
    fn augment_args(command: Command) -> Command {
        let command = CameraOptions::augment_args(command);
        let needed: Vec<Id> = ["camera", "stage", "output", "baseline"].map(Id::from).into();
        let command = needed.iter().fold(command, |command, id| {
            command.mut_arg(id, |arg| arg.required(false).required_unless_present(RIG).conflicts_with(RIG))
        });
        command.arg(
            Arg::new(RIG)
                .value_name("RIG_DIR")
                .value_parser(value_parser!(PathBuf))
                .help("Captured folder with a rig.toml, without a camera: the same as `multiscopic tune RIG_DIR`"),
        )
    }

    fn augment_args_for_update(command: Command) -> Command {
        LiveSource::augment_args(command)
    }
}

impl FromArgMatches for LiveSource {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<LiveSource, clap::Error> {
        Ok(match matches.get_one::<PathBuf>(RIG) {
            Some(rig) => LiveSource::Rig(rig.clone()),
            None => LiveSource::Camera(Box::new(CameraOptions::from_arg_matches(matches)?)),
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> std::result::Result<(), clap::Error> {
        *self = LiveSource::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Serves a page on which a captured folder is matched while you set the method, the range, the block and the filters
///
/// The picture follows the sliders. Beside it stand the command of `match` that gives these disparities, the same in Rust, and
/// what the match would take on a microcontroller. The page is that of `multiscopic view`. It is served on the loopback address,
/// to whoever has the address with its token. Ctrl-C ends it.
#[derive(Debug, Args)]
pub struct Tune {
    /// Captured folder with a rig.toml
    #[arg(value_name = "RIG_DIR")]
    rig: PathBuf,

    #[command(flatten)]
    serving: ServingOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

impl Tune {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        tune(&self.rig, &self.serving, &self.engine)
    }
}

/// Serves the page of a captured folder until a signal comes.
pub fn tune(folder: &Path, serving: &ServingOptions, engine: &EngineOptions) -> Result<ExitCode> {
    let rig = TunedRig::open(folder)?;
    let bench = Arc::new(Workbench::new(engine.engine()?));
    bench.open(rig);
    let title = view::title(folder);
    let page = Page { title: &title, has_camera: false };
    serving.bind()?.serve(page, &bench, Arc::new(Tuning(bench.clone())), |signals| signals > 0)
}

/// The messages of `tune`.
struct Tuning(Arc<Workbench>);

/// A message of a page of `tune`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Message {
    Match(Wish),
}

impl Messages for Tuning {
    fn board(&self) -> &NoticeBoard {
        &self.0.board
    }

    fn take(&self, text: &str) -> std::result::Result<(), String> {
        let Message::Match(wish) = serde_json::from_str(text).map_err(|error| error.to_string())?;
        self.0.ask(wish);
        Ok(())
    }
}
