//! Runs a target without libFuzzer and its instruments, which takes no C++ compiler: on each file of folders of seeds, and on
//! random changes of them, which are the same each time with the same number to begin with.
//!
//! ```text
//! blind TARGET NUMBER INPUTS SECONDS SEEDS...
//! ```
//!
//! An input may take so many seconds.

use std::{
    env, fs, panic,
    path::{Path, PathBuf},
    process,
    sync::{Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

use multiscopic_fuzz::Target;
use multiscopic_reference::split_mix::Random;

/// The longest input in bytes, if the seeds are shorter.
const LONGEST: usize = 4096;

/// The input that is tried, and since when. If it breaks something, it is written to a file.
static INPUT: Mutex<(Vec<u8>, Option<Instant>)> = Mutex::new((Vec::new(), None));

fn main() {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [name, number, inputs, seconds, seeds @ ..] = &arguments[..] else { panic!("TARGET NUMBER INPUTS SECONDS SEEDS...") };
    let target = Target::named(name).unwrap_or_else(|| panic!("no target is called {name}"));
    let (number, inputs) = (number.parse().expect("a number"), inputs.parse().expect("a number of inputs"));
    let longest = Duration::from_secs(seconds.parse().expect("a number of seconds"));
    let seeds: Vec<Vec<u8>> = seeds.iter().flat_map(|folder| files(Path::new(folder))).collect();
    assert!(!seeds.is_empty(), "no seeds");
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |what| {
        usual(what);
        let path = env::temp_dir().join(format!("fuzz-failure-{}", process::id()));
        let _ = fs::write(&path, &INPUT.lock().unwrap_or_else(PoisonError::into_inner).0);
        eprintln!("the input is {}", path.display());
        process::abort();
    }));
    thread::spawn(move || {
        loop {
            thread::sleep(Duration::from_secs(1));
            let start = INPUT.lock().map(|input| input.1);
            assert!(start.is_ok_and(|start| start.is_none_or(|start| start.elapsed() < longest)), "an input takes too long");
        }
    });
    let random = &mut Random(number);
    for seed in &seeds {
        test(target, seed.clone());
    }
    for _ in seeds.len()..inputs {
        test(target, changed(&seeds, random));
    }
    println!("{} inputs", inputs.max(seeds.len()));
}

fn test(target: Target, input: Vec<u8>) {
    *INPUT.lock().expect("an input") = (input.clone(), Some(Instant::now()));
    (target.run)(&input);
}

/// The contents of a folder's files, in the order of their names.
fn files(folder: &Path) -> Vec<Vec<u8>> {
    let entries = fs::read_dir(folder).expect("a folder of seeds");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("a seed")).collect()
}

/// A seed with one to eight changes: bits, bytes, numbers, what is cut out, repeated, or taken from another seed.
fn changed(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut input = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(8) {
        if input.is_empty() {
            input.push(random.byte());
        }
        let place = random.below(input.len());
        let end = place + random.below((input.len() - place).min(64) + 1);
        match random.below(7) {
            0 => input[place] ^= 1 << random.below(8),
            1 => input[place] = random.byte(),
            2 => input[place] = [0, 1, 0x7F, 0x80, 0xFF][random.below(5)],
            3 => drop(input.drain(place..end)),
            4 => {
                let part = input[place..end].to_vec();
                input.splice(place..place, part);
            }
            5 => input.insert(place, random.byte()),
            _ => {
                let other = &seeds[random.below(seeds.len())];
                let start = random.below(other.len() + 1);
                let length = random.below((other.len() - start).min(64) + 1);
                input.splice(place..end, other[start..start + length].iter().copied());
            }
        }
    }
    input.truncate(LONGEST.max(seeds.iter().map(Vec::len).max().unwrap_or(0)));
    input
}
