//! Threads and vector instructions.

use clap::Args;
use multiscopic::{Engine, Error, Result, Simd};

/// What the machine gives.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct EngineOptions {
    /// Threads, 0 for one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub threads: usize,

    /// Vector instructions, by default the fastest for the number of disparities that the processor has; the result is the same
    #[arg(long, value_name = "NAME")]
    pub simd: Option<String>,
}

impl EngineOptions {
    /// The engine asked for.
    pub fn engine(&self) -> Result<Engine> {
        let named = |name: &String| {
            Simd::named(name).ok_or_else(|| {
                let available: Vec<String> = Simd::available().iter().map(Simd::to_string).collect();
                Error::Usage(format!("--simd is {name}, this processor has {}", available.join(", ")))
            })
        };
        Engine::new(self.simd.as_ref().map(named).transpose()?, self.threads)
    }
}
