//! Detecting moves that make no progress.

use std::time::{Duration, Instant};

/// Measures how long a stage has come no nearer to its target.
#[derive(Clone, Copy, Debug)]
pub(super) struct StallTimer {
    /// The shortest distance to the target so far.
    nearest: f64,
    /// When it was reached.
    since: Instant,
    /// How much nearer counts as progress.
    min_step: f64,
}

impl StallTimer {
    /// Starts at time `now`, at a distance from the target. All distances are in one unit, the caller's.
    pub(super) fn start(distance: f64, min_step: f64, now: Instant) -> StallTimer {
        StallTimer { nearest: distance, since: now, min_step }
    }

    /// Takes the distance at time `at`, and returns how long there has been no progress.
    pub(super) fn update(&mut self, distance: f64, at: Instant) -> Duration {
        if distance < self.nearest - self.min_step {
            (self.nearest, self.since) = (distance, at);
        }
        at.saturating_duration_since(self.since)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_progress_resets_the_timer() {
        let mut timer = StallTimer::start(10.0, 0.5, Instant::now());
        let seconds = |number| timer.since + Duration::from_secs(number);
        let [at_1, at_3, at_4] = [1, 3, 4].map(seconds);
        assert_eq!(timer.update(9.6, at_1), Duration::from_secs(1));
        assert_eq!(timer.update(9.4, at_3), Duration::ZERO);
        assert_eq!(timer.update(12.0, at_4), Duration::from_secs(1));
    }
}
