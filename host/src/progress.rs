//! What long work tells of itself while it goes on.

/// Whoever watches work, from any thread. Every method does nothing unless it is said otherwise.
pub trait Progress: Sync {
    /// Work of so many steps begins; what a step is, in the plural.
    fn begin(&self, _steps: u64, _name: &str) {}

    /// So many steps more are done.
    fn advance(&self, _steps: u64) {}

    /// How it stands.
    fn say(&self, _message: &str) {}

    /// Whether the work should end early, with the best that it has so far.
    fn is_interrupted(&self) -> bool {
        false
    }
}

/// Nobody watches.
impl Progress for () {}
