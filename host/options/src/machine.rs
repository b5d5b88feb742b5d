//! Threads, vector instructions and memory.

use clap::Args;
use multiscopic::{Engine, Error, Result, Simd, memory_limit};

use crate::value::count;

/// The threads, vector instructions and memory that matching may use.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct EngineOptions {
    /// Number of threads, 0 for one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub threads: usize,

    /// Vector instructions; they do not change the result [default: the fastest available for the number of disparities]
    #[arg(long, value_name = "NAME", value_parser = simd)]
    simd: Option<Simd>,

    /// The memory.
    #[command(flatten)]
    pub memory: MemoryOptions,
}

/// The memory that the program may take.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct MemoryOptions {
    /// Refuse what takes more memory, in megabytes [default: what is available]
    #[arg(long, value_name = "MB", value_parser = count)]
    max_memory: Option<u64>,
}

impl EngineOptions {
    /// Returns the engine with these options.
    ///
    /// # Errors
    /// If there are too many threads.
    pub fn engine(&self) -> Result<Engine> {
        Ok(Engine::new(self.simd, self.threads)?.with_most_bytes(self.memory.most_bytes()))
    }
}

impl MemoryOptions {
    /// Returns the most bytes that may be taken. `None` if nothing limits them.
    pub fn most_bytes(&self) -> Option<u64> {
        memory_limit(self.max_memory)
    }
}

/// Parses the name of vector instructions that this processor has.
fn simd(name: &str) -> Result<Simd> {
    Simd::named(name).ok_or_else(|| {
        let available: Vec<String> = Simd::available().iter().map(Simd::to_string).collect();
        Error::Usage(format!("it must be one of {}, which this processor has", available.join(", ")))
    })
}
