//! The limits of what this run reads: those of `--max-pixels`.

use std::sync::OnceLock;

use multiscopic::files::Limits;

static LIMITS: OnceLock<Limits> = OnceLock::new();

/// Sets the limits of this run, before anything is read.
pub fn set(limits: Limits) {
    LIMITS.set(limits).expect("the limits are set once");
}

/// The limits of this run.
pub fn limits() -> Limits {
    LIMITS.get().copied().unwrap_or_default()
}
