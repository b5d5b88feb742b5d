//! The firmware on a Cortex-M processor.

mod fault;
mod host_file;

use core::{ffi::CStr, fmt};
use cortex_m as _; // brings the critical section
use cortex_m_rt::entry;
use multiscopic_core::{Params, ScanlineSource};
use multiscopic_edge::{PipelineError, Profile, Streams, Workspace, files, profile};
use semihosting::{println, process};
use static_cell::ConstStaticCell;

use host_file::{HostError, HostFile};

const PROFILE: Profile = profile::SMALL;
const PARAMS: Params = PROFILE.params;

static WORKSPACE: ConstStaticCell<Workspace<{ PARAMS.memory_words() }, { PARAMS.width() }>> =
    ConstStaticCell::new(Workspace::new(&PARAMS));

#[entry]
fn main() -> ! {
    println!("firmware: profile {}", PROFILE.name);
    match run() {
        Ok(lines) => println!("firmware: {lines} disparity lines"),
        Err(error) => fault::fail(error),
    }
    process::exit(0)
}

/// Matches the files of the host.
fn run() -> Result<usize, Failure> {
    let open = |frame| HostFile::open(files::frame(frame)).map_err(|error| Failure::File(files::frame(frame), error));
    let mut source = Streams::open(PARAMS.views(), open)?;
    let mut output = HostFile::create(files::DISPARITY).map_err(|error| Failure::File(files::DISPARITY, error))?;
    WORKSPACE.take().run(&PARAMS, &mut source, &mut output).map_err(Failure::Pipeline)
}

/// Why the firmware did not come to its end.
enum Failure {
    /// A file could not be opened.
    File(&'static CStr, HostError),
    /// A line could not be read, matched or written.
    Pipeline(PipelineError<<Streams<HostFile> as ScanlineSource>::Error, HostError>),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::File(path, error) => write!(f, "cannot open {}: {error}", path.to_str().unwrap_or("a file")),
            Failure::Pipeline(error) => write!(f, "{error}"),
        }
    }
}
