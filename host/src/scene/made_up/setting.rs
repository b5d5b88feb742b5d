//! Where random scenes are captured.

/// Where a random scene is captured, and with what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Setting {
    /// Anything, by a small and noisy camera on a cheap stage.
    #[default]
    Field,
    /// Before walls that are often plain, by a good camera on an exact stage, as most published data sets are.
    Studio,
}
