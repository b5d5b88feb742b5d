//! The page of `tune` and `live`: its contents, its address, and the time for which it is served.

use std::{
    net::SocketAddr,
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use clap::Args;
use multiscopic::{Error, Processor, Result};
use serde_json::json;
use tokio::runtime::{Builder, Runtime};

use super::{
    server::{Messages, Server},
    workbench::Workbench,
};
use crate::{
    command::{
        options::Named,
        terminal::{self, signals},
        view::command_line,
    },
    report::{LivePanel, Report},
};

/// The time between two looks for Ctrl-C.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The address of the page.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Page")]
pub struct ServingOptions {
    /// Address and port to listen on; port 0 is any that is free. At another address than the loopback's, whoever reads along on
    /// the way can use the page too, since it is not encrypted
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    listen: SocketAddr,

    /// Do not open the page; it is never opened unless messages go to a terminal
    #[arg(long)]
    no_open: bool,
}

/// A server that listens.
pub struct Served {
    runtime: Runtime,
    server: Server,
    no_open: bool,
    /// Counts the signals.
    signals: Arc<AtomicUsize>,
}

impl ServingOptions {
    /// Listens. From then on, Ctrl-C no longer ends the program.
    pub fn bind(&self) -> Result<Served> {
        let runtime = Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| Error::Usage(format!("cannot start the server: {error}")))?;
        let server = runtime.block_on(Server::bind(self.listen))?;
        Ok(Served { runtime, server, no_open: self.no_open, signals: signals::count(usize::MAX) })
    }
}

impl Served {
    /// Serves a page, and matches what it asks for. `is_over` is asked again and again, with the number of signals that have
    /// come.
    pub fn serve(
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
const MODULES: [(&str, &str); 3] = [
    ("live/camera.js", include_str!("page/camera.js")),
    ("live/link.js", include_str!("page/link.js")),
    ("live/tuning.js", include_str!("page/tuning.js")),
];

/// The contents of the page.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    pub title: &'a str,
    /// True if there is a camera beside the matching.
    pub has_camera: bool,
}

impl Page<'_> {
    /// The page in HTML.
    pub fn html(self, bench: &Workbench) -> String {
        let processor = |processor: &Processor| json!({ "name": processor.name(), "clock_mhz": processor.clock_mhz() });
        let processors: Vec<_> = Processor::ALL.iter().map(processor).collect();
        let data = json!({ "controls": bench.controls(), "processors": processors });
        let camera = if self.has_camera { CAMERA } else { "" };
        let markup = format!("<div class=\"side\">{camera}{TUNING}</div>");
        let panel = LivePanel { markup: &markup, style: STYLE, modules: &MODULES, start: START, data };
        Report::new(self.title).live_viewer(&command_line(), panel).to_html()
    }
}
