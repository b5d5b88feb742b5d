//! Threads, vector instructions and memory.

use clap::{Args, value_parser};
use multiscopic::{Engine, Error, Result, Simd};

use super::available_memory;

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

    /// Refuse matches that take more memory, in megabytes [default: what is available]
    #[arg(long, value_name = "MB", value_parser = value_parser!(u64).range(1..))]
    pub max_memory: Option<u64>,
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
        let megabytes = self.max_memory.map(|megabytes| megabytes.saturating_mul(1_000_000));
        Ok(engine.with_most_bytes(megabytes.or_else(available_memory::bytes)))
    }
}
