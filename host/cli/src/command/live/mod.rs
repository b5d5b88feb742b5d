//! `multiscopic tune` and `multiscopic live`: a page on which a rig is matched while the options of `match` are set, and a camera
//! takes further rigs.

mod notice_board;
mod server;
mod studio;
mod tuned_rig;
mod workbench;

use std::{
    fs,
    net::SocketAddr,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, Id, value_parser};
use multiscopic::{Error, Processor, Result};
use serde::Deserialize;
use serde_json::json;
use tokio::runtime::{Builder, Runtime};

use self::{
    notice_board::NoticeBoard,
    server::{Messages, Server},
    studio::Studio,
    tuned_rig::TunedRig,
    workbench::{Wish, Workbench},
};
use super::{
    capture::RecorderOptions,
    foxglove::FoxgloveOptions,
    options::{EngineOptions, Named},
    terminal::{self, signals},
    view::{self, command_line},
};
use crate::report::{LivePanel, Report};

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
        let publisher = self.serving.foxglove.publisher(recorder.parts.focal_px.is_some())?;
        let bench = Arc::new(Workbench::new(self.engine.engine()?, publisher));
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
enum LiveSource {
    /// `RIG_DIR`.
    Rig(PathBuf),
    /// `--camera` and what it needs.
    Camera(Box<CameraOptions>),
}

/// The camera, the stage, and the folder of the sets.
#[derive(Debug, Args)]
struct CameraOptions {
    #[command(flatten)]
    recorder: RecorderOptions,

    /// Folder for the sets, which become its folders 0001, 0002, and so on
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
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
        // It is for `capture`.
        let command = command.mut_arg("sweep", |arg| arg.hide(true));
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
fn tune(folder: &Path, serving: &ServingOptions, engine: &EngineOptions) -> Result<ExitCode> {
    let rig = TunedRig::open(folder)?;
    let publisher = serving.foxglove.publisher(rig.has_geometry())?;
    let bench = Arc::new(Workbench::new(engine.engine()?, publisher));
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

/// The time between two looks for Ctrl-C.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The address of the page.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Page")]
struct ServingOptions {
    /// Address and port to listen on; port 0 is any that is free. At another address than the loopback's, whoever reads along on
    /// the way can use the page too, since it is not encrypted
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    listen: SocketAddr,

    /// Do not open the page; it is never opened unless messages go to a terminal
    #[arg(long)]
    no_open: bool,

    #[command(flatten)]
    foxglove: FoxgloveOptions,
}

/// A server that listens.
struct Served {
    runtime: Runtime,
    server: Server,
    no_open: bool,
    /// Counts the signals.
    signals: Arc<AtomicUsize>,
}

impl ServingOptions {
    /// Listens. From then on, Ctrl-C no longer ends the program.
    fn bind(&self) -> Result<Served> {
        let runtime = Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| Error::Usage(format!("cannot start the server: {error}")))?;
        let server = runtime.block_on(Server::bind(self.listen))?;
        Ok(Served { runtime, server, no_open: self.no_open, signals: signals::count(usize::MAX) })
    }
}

impl Served {
    /// Serves a page, and matches what it asks for. `is_over` is asked again and again, with the number of signals that have
    /// come.
    fn serve(
        self,
        page: Page<'_>,
        bench: &Arc<Workbench>,
        messages: Arc<dyn Messages>,
        is_over: impl Fn(usize) -> bool,
    ) -> Result<ExitCode> {
        let address = self.server.address();
        terminal::say(&format!("open {address}"));
        if !self.no_open {
            terminal::open(address.as_ref());
        }
        let matching = {
            let bench = bench.clone();
            thread::spawn(move || bench.run())
        };
        self.runtime.block_on(self.server.run(page.html(bench), messages, async {
            while !is_over(self.signals.load(Ordering::Relaxed)) && !matching.is_finished() {
                tokio::time::sleep(POLL_INTERVAL).await;
            }
        }));
        bench.close();
        // A match under way is left to the end of the program, since nothing waits for it. A thread that has ended by itself has
        // panicked.
        if matching.is_finished()
            && let Err(panic) = matching.join()
        {
            std::panic::resume_unwind(panic);
        }
        Ok(signals::exit_code().map_or(ExitCode::SUCCESS, ExitCode::from))
    }
}

const STYLE: &str = include_str!("page/panel.css");
const CAMERA: &str = include_str!("page/camera.html");
const TUNING: &str = include_str!("page/tuning.html");
const START: &str = include_str!("page/start.js");

/// The modules that others import, by name.
const MODULES: [(&str, &str); 2] =
    [("live/camera.js", include_str!("page/camera.js")), ("live/tuning.js", include_str!("page/tuning.js"))];

/// The contents of the page.
#[derive(Clone, Copy, Debug)]
struct Page<'a> {
    title: &'a str,
    /// True if there is a camera beside the matching.
    has_camera: bool,
}

impl Page<'_> {
    /// The page in HTML.
    fn html(self, bench: &Workbench) -> String {
        let processor = |processor: &Processor| json!({ "name": processor.name(), "clock_mhz": processor.clock_mhz() });
        let processors: Vec<_> = Processor::ALL.iter().map(processor).collect();
        let data = json!({ "controls": bench.controls(), "processors": processors });
        let camera = if self.has_camera { CAMERA } else { "" };
        let markup = format!("<div class=\"side\">{camera}{TUNING}</div>");
        let panel = LivePanel { markup: &markup, style: STYLE, modules: &MODULES, start: START, data };
        Report::new(self.title).live_viewer(&command_line(), panel).to_html()
    }
}
