//! Processes, threads, ports and folders.

pub mod background_task;
pub mod folders;
pub mod process;

use anyhow::Result;
use std::{
    io, iter,
    net::{Ipv4Addr, TcpListener},
    sync::Mutex,
    thread,
};

/// The number of emulators or other programs that run at once.
const AT_A_TIME: usize = 2;

/// Applies `work` to all `items` in parallel, and returns the results in order, or a failure.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> Result<R> + Sync) -> Result<Vec<R>> {
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

/// As many ports that nothing listens at as are asked for. Whoever is to listen at them should do so soon.
pub fn free_ports<const N: usize>() -> Result<[u16; N]> {
    // All are held before any is let go, so that each is another one.
    let listeners = iter::repeat_with(|| TcpListener::bind((Ipv4Addr::LOCALHOST, 0))).take(N).collect::<io::Result<Vec<_>>>()?;
    let ports = listeners.iter().map(|listener| Ok(listener.local_addr()?.port())).collect::<io::Result<Vec<u16>>>()?;
    Ok(ports.try_into().expect("as many as were asked for"))
}
