//! The command `tune`.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
};

use clap::Args;
use multiscopic::Result;
use serde::Deserialize;

use super::{
    live_page::Page,
    notice_board::NoticeBoard,
    server::Messages,
    serving::ServingOptions,
    tuning::{TunedRig, Wish, Workbench},
};
use crate::command::{options::EngineOptions, view};

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
