//! A pool of worker threads for emulators.

use anyhow::Result;
use std::{sync::Mutex, thread};

/// The number of emulators that run at once.
const AT_A_TIME: usize = 2;

/// Applies `work` to all `items` in parallel, and returns the results in order, or a failure.
pub fn map<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> Result<R> + Sync) -> Result<Vec<R>> {
    let (next, done) = (Mutex::new(items.iter().enumerate()), Mutex::new(Vec::new()));
    let take = || next.lock().expect("no thread panics here").next();
    let run = || -> Result<()> {
        while let Some((i, item)) = take() {
            let result = work(item)?;
            done.lock().expect("no thread panics here").push((i, result));
        }
        Ok(())
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..AT_A_TIME).map(|_| scope.spawn(run)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("no thread panics here"))
    })?;
    let mut done = done.into_inner().expect("no thread panics here");
    done.sort_by_key(|&(i, _)| i);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}
