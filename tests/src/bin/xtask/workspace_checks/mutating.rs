//! Breaks the code in many small ways, one at a time, and looks whether a test notices.

use std::fs;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::{system, tools};

/// The parts of the code to break.
#[derive(Args)]
pub struct Mutating {
    /// Parts of the code [default: all]
    #[arg(value_parser = PARTS.map(|part| part.name))]
    parts: Vec<String>,

    /// Take every N-th mutant alone, from the I-th on, counted from 0: a sample, or a share of the work
    #[arg(long, value_name = "I/N")]
    shard: Option<String>,
}

/// A part of the code, and what tests it.
struct Part {
    name: &'static str,
    package: &'static str,
    /// Globs of its files.
    files: &'static [&'static str],
    /// Globs of files among them that another part has, or that this machine does not compile.
    excluded: &'static [&'static str],
    /// The tests, as arguments of `cargo test`.
    tests: &'static [&'static str],
    /// Words in the names of the tests that are run, and options that skip slow ones that look at other code.
    words: &'static [&'static str],
}

const PARTS: [Part; 6] = [
    Part {
        name: "capture",
        package: "multiscopic-core",
        files: &["core/src/capture/**"],
        excluded: &[],
        tests: &["--lib", "--test=capture"],
        words: &["capture::tests::", "path::", "sequence::"],
    },
    Part {
        name: "selection",
        package: "multiscopic-core",
        files: &["core/src/{fusion,region}.rs", "core/src/matcher/selection.rs"],
        excluded: &[],
        tests: &["--lib", "--test=matching"],
        words: &[],
    },
    Part {
        name: "paths",
        package: "multiscopic-core",
        files: &["core/src/semi_global/**", "core/src/kernel/bytes/**"],
        excluded: &[],
        tests: &["--lib", "--test=matching", "--test=methods"],
        words: &["pairs", "passes", "path", "semi_global", "sgm", "--skip=larger_images", "--skip=trained_network"],
    },
    Part {
        name: "matching",
        package: "multiscopic-core",
        files: &["core/src/**"],
        excluded: &[
            "core/src/{fusion,region}.rs",
            "core/src/matcher/selection.rs",
            "core/src/{capture,network,semi_global}/**",
            "core/src/kernel/aarch64.rs",
            "core/src/kernel/{arm,bytes}/**",
        ],
        tests: &["--lib", "--test=matching", "--test=rectified_lines"],
        words: &[],
    },
    Part {
        name: "network",
        package: "multiscopic-core",
        files: &["core/src/network/**"],
        excluded: &[],
        tests: &["--lib", "--test=methods"],
        words: &["network", "--skip=beats_semi_global_matching"],
    },
    Part {
        name: "readers",
        package: "multiscopic",
        files: &[
            "host/src/files/{disparity_files,frame_files,image_codec,input,npy,picture_files,rig_file}.rs",
            "host/src/files/jpeg_scans/**",
            "host/src/lens/calibration_files/**",
        ],
        excluded: &["**/tests.rs"],
        tests: &["--lib", "--test=outside_bytes"],
        words: &["--skip=command_lines_are_refused"],
    },
];

impl Mutating {
    /// A sample of all parts.
    pub fn sample() -> Mutating {
        Mutating { parts: Vec::new(), shard: Some("0/54".to_owned()) }
    }

    /// Every mutant of a part.
    pub fn of(part: &str) -> Mutating {
        Mutating { parts: vec![part.to_owned()], shard: None }
    }

    /// Tries the mutants of the parts. Fails if tests miss one that `.cargo/mutants.toml` does not explain.
    pub fn run(&self) -> Result<()> {
        let selected = |part: &&Part| self.parts.is_empty() || self.parts.iter().any(|name| name == part.name);
        let missed = PARTS.iter().filter(selected).map(|part| self.try_mutants(part)).sum::<Result<u64>>()?;
        ensure!(missed == 0, "the tests miss {missed} mutants");
        Ok(())
    }

    /// Tries the mutants of a part, prints how many were noticed, and returns how many were not.
    fn try_mutants(&self, part: &Part) -> Result<u64> {
        let folder = system::target().join("mutants").join(part.name);
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let mut mutants = tools::MUTANTS.command()?;
        mutants.args(["--package", part.package, "--no-default-features", "--profile", "mutants"]);
        mutants.args(part.files.iter().flat_map(|glob| ["--file", glob]));
        mutants.args(part.excluded.iter().flat_map(|glob| ["--exclude", glob]));
        if let Some(shard) = &self.shard {
            mutants.args(["--sharding", "round-robin", "--shard", shard]);
        }
        // For building as for running: other tests need not compile.
        mutants.args(["--cargo-arg=--package=multiscopic-core", "--cargo-arg=--package=multiscopic-tests"]);
        mutants.args(part.tests.iter().map(|test| format!("--cargo-arg={test}")));
        mutants.arg("--output").arg(&folder).args(["--", "--"]).args(part.words);
        // Each run copies the sources, but the dependencies need no other build.
        mutants.env("CARGO_TARGET_DIR", system::target().join("mutants/build"));
        // Without optimisation, tests take longer, and matching needs more stack than threads of tests have.
        mutants.env("MULTISCOPIC_EFFORT", "0.1").env("PROPTEST_CASES", "50").env("RUST_MIN_STACK", "100000000");
        let status = mutants.env("CARGO_INCREMENTAL", "1").status()?;
        // Two and three: missed mutants, and those that did not end in time.
        if !matches!(status.code(), Some(0 | 2 | 3)) {
            bail!("cargo mutants failed ({status})");
        }
        let outcomes = folder.join("mutants.out/outcomes.json");
        let text = fs::read_to_string(&outcomes).with_context(|| format!("cannot read {}", outcomes.display()))?;
        let outcomes: serde_json::Value = serde_json::from_str(&text)?;
        let count = |name: &str| outcomes[name].as_u64().with_context(|| format!("cargo mutants does not count {name:?}"));
        let [all, caught, missed, timeout, unviable] = ["total_mutants", "caught", "missed", "timeout", "unviable"].map(count);
        let (all, missed) = (all?, missed?);
        println!(
            "mutants: {}: {all} mutants, of which {} do not compile; tests noticed {}, missed {missed}, and {} did not end",
            part.name, unviable?, caught?, timeout?
        );
        Ok(missed)
    }
}
