//! Threads, vector instructions and memory.

use clap::Args;
use multiscopic::{Engine, Error, Result, Simd};

use super::MemoryOptions;

/// The threads, vector instructions and memory that matching may use.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct EngineOptions {
    /// Number of threads, 0 for one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub threads: usize,

    /// Vector instructions; they do not change the result [default: the fastest available for the number of disparities]
    #[arg(long, value_name = "NAME")]
    pub simd: Option<String>,

    #[command(flatten)]
    pub memory: MemoryOptions,
}

impl EngineOptions {
    /// The engine with these options.
    pub fn engine(&self) -> Result<Engine> {
        let named = |name: &String| {
            Simd::named(name).ok_or_else(|| {
                let available: Vec<String> = Simd::available().iter().map(Simd::to_string).collect();
                Error::Usage(format!("--simd is {name}, but this processor supports {}", available.join(", ")))
            })
        };
        let engine = Engine::new(self.simd.as_ref().map(named).transpose()?, self.threads)?;
        Ok(engine.with_most_bytes(self.memory.most_bytes()))
    }
}
