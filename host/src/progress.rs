//! How long-running work reports its progress, and how it is interrupted.

/// Receives reports from long-running work, on any thread. By default every method does nothing.
pub trait Progress: Sync {
    /// A stage of `steps` steps begins. `name` is what a step is called, in the plural.
    fn begin(&self, _steps: u64, _name: &str) {}

    /// `steps` more steps are done.
    fn advance(&self, _steps: u64) {}

    /// A message about the current state.
    fn say(&self, _message: &str) {}

    /// Whether the work should stop early and return its best result so far.
    fn is_interrupted(&self) -> bool {
        false
    }
}

/// Ignores all reports and never interrupts.
impl Progress for () {}
