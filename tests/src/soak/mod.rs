//! Captures and matches over and over, on simulated hardware that fails at random, in one process whose resources are watched.

mod failing_rig;

use std::{
    collections::BTreeMap,
    fs,
    sync::Mutex,
    thread,
    time::{Duration, Instant},
};

use multiscopic_reference::split_mix::Random;

use failing_rig::FailingRig;

/// The number of captures of ten that have a trouble.
const TROUBLED: usize = 3;
/// The growth of memory after the first rounds that is allowed, in KiB: the allocator's own fragments.
const GROWTH_KIB: u64 = 8 * 1024;
/// The time that threads and connections that are closed may take to be gone. Only a leak reaches it.
const CLOSING: Duration = Duration::from_secs(60);
/// The time after the first round for which nothing may change.
const REST: Duration = Duration::from_secs(2);

/// Numbers of captures, and of rigs that take them at once.
#[derive(Clone, Copy, Debug)]
pub struct Soak {
    /// Captures in all, rounded up to whole rounds.
    pub captures: usize,
    /// Rigs that capture at the same time.
    pub rigs: usize,
    /// Captures of each rig between two looks at the process.
    pub captures_per_round: usize,
    /// Seed of the troubles.
    pub seed: u64,
}

/// The resources of the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Usage {
    /// Captures so far.
    pub captures: usize,
    /// Resident memory in KiB.
    pub resident_kib: u64,
    /// Open files, sockets and terminals.
    pub descriptors: usize,
    /// Threads.
    pub threads: usize,
}

/// The number of captures that had each trouble.
pub type Troubles = BTreeMap<&'static str, usize>;

impl Soak {
    /// Captures until all are done. Tells `observe` the resources of the process after each round, when all rigs are at rest.
    /// Panics if anything is not as it should be.
    pub fn run(&self, mut observe: impl FnMut(&Usage)) -> Troubles {
        let rigs: Vec<(FailingRig, Mutex<Random>)> =
            (0..self.rigs).map(|number| (FailingRig::start(number), Mutex::new(Random(self.seed + number as u64)))).collect();
        let counts = Mutex::new(Troubles::new());
        let troubles = &counts;
        let mut usages: Vec<Usage> = Vec::new();
        let rounds = self.captures.div_ceil(self.rigs * self.captures_per_round);
        for round in 1..=rounds {
            thread::scope(|scope| {
                for (rig, random) in &rigs {
                    scope.spawn(move || {
                        let mut random = random.lock().expect("no other round runs");
                        for _ in 0..self.captures_per_round {
                            let trouble = (random.below(10) < TROUBLED).then(|| rig.trouble(&mut random));
                            rig.capture(trouble, &mut random);
                            let name = trouble.map_or("none", failing_rig::Trouble::name);
                            *troubles.lock().expect("no panic while it is locked").entry(name).or_default() += 1;
                        }
                    });
                }
            });
            let captures = round * self.rigs * self.captures_per_round;
            let usage = Usage::settled(captures, Usage::least(&usages));
            observe(&usage);
            usages.push(usage);
        }
        // The first half warms up.
        let [half, last] = [usages[usages.len() / 2], usages[usages.len() - 1]];
        let least = Usage::least(&usages).expect("a round");
        assert_eq!([last.descriptors, last.threads], least, "descriptors and threads, {usages:?}");
        assert!(last.resident_kib <= half.resident_kib + GROWTH_KIB, "memory grows: {usages:?}");
        counts.into_inner().expect("no thread is left")
    }
}

impl Usage {
    fn now(captures: usize) -> Usage {
        let status = fs::read_to_string("/proc/self/status").expect("Linux tells");
        let number = |label: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(label)).expect("Linux tells");
            line.split_whitespace().next().and_then(|number| number.parse().ok()).expect("a number")
        };
        let descriptors = fs::read_dir("/proc/self/fd").expect("Linux tells").count();
        Usage { captures, resident_kib: number("VmRSS:"), descriptors, threads: number("Threads:") as usize }
    }

    /// The least descriptors and threads of all looks: on a busy machine, the first one may see some that are not yet closed.
    fn least(usages: &[Usage]) -> Option<[usize; 2]> {
        let least = |number: fn(&Usage) -> usize| usages.iter().map(number).min();
        Some([least(|usage| usage.descriptors)?, least(|usage| usage.threads)?])
    }

    /// The resources of the process once they are no more than the `least` descriptors and threads before.
    fn settled(captures: usize, least: Option<[usize; 2]>) -> Usage {
        let start = Instant::now();
        let mut before = Usage::now(captures);
        loop {
            thread::sleep(Duration::from_millis(100));
            let now = Usage::now(captures);
            let is_settled = match least {
                Some([descriptors, threads]) => now.descriptors <= descriptors && now.threads <= threads,
                None => (now.descriptors, now.threads) == (before.descriptors, before.threads) && start.elapsed() > REST,
            };
            if is_settled || start.elapsed() > CLOSING {
                return now;
            }
            before = now;
        }
    }
}
