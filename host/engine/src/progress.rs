//! Progress reports of long-running work, and its interruption.

/// Receives reports from long-running work, on any thread. By default every method does nothing.
pub trait Progress: Sync {
    /// A stage of `steps` steps begins. `name` is what a step is called, in the plural.
    fn begin(&self, _steps: u64, _name: &str) {}

    /// `steps` more steps are done.
    fn advance(&self, _steps: u64) {}

    /// A message about the current state.
    fn say(&self, _message: &str) {}

    /// Returns true if the work should stop early. Graph cuts then return the best labelling so far; all other methods leave
    /// pixels that they have not come to without a disparity.
    fn is_interrupted(&self) -> bool {
        false
    }
}

/// Ignores all reports and never interrupts.
impl Progress for () {}
