//! Checks that the suite's builds share their dependencies.
//!
//! Cargo builds a package again for other features, and then whatever depends on it. Which features a package has depends on what is
//! built together: the runner alone, the program, the module for Python, or all tests.

use anyhow::{Result, ensure};
use std::collections::{BTreeMap, BTreeSet};

use crate::system::{OPTIMIZED, OPTIMIZED_PROGRAM, PYTHON_PACKAGE, command, read};

/// Packages that take a moment to build.
const CHEAP: [&str; 1] = ["multiscopic-drivers"];

/// The sets of features of each package, by name and version.
type Features = BTreeMap<String, BTreeSet<String>>;

/// Fails if a package has features in one build of the suite that it does not have in another.
pub fn check() -> Result<()> {
    let program = ["-pmultiscopic-cli", "-pmultiscopic-tests"];
    let all = features(&["--workspace", "--edges=normal,build,dev"])?;
    let mut complaints = Vec::new();
    for (build, packages) in [
        ("the runner", &["-pmultiscopic-tests"][..]),
        ("the program in debug", &program),
        ("the module for Python", &[&program[..], &["-p", PYTHON_PACKAGE]].concat()),
    ] {
        let own = features(&[packages, &["--edges=normal,build"]].concat())?;
        complaints.extend(differences(build, &own, "the tests in debug", &all));
    }
    let tests = features(&[&OPTIMIZED[..], &["--edges=normal,build,dev"]].concat())?;
    let program = features(&[&OPTIMIZED[..], &OPTIMIZED_PROGRAM, &["--edges=normal,build"]].concat())?;
    complaints.extend(differences("the program in release", &program, "the tests in release", &tests));
    ensure!(
        complaints.is_empty(),
        "packages are built twice; see the end of tests/Cargo.toml's dependencies:\n{}",
        complaints.join("\n")
    );
    println!("features: every build of the suite asks for the same ones");
    Ok(())
}

/// The packages that are part of two builds, with other features in the first.
fn differences(build: &str, features: &Features, other_build: &str, others: &Features) -> Vec<String> {
    let differs = |(package, own): (&String, &BTreeSet<String>)| {
        let other = others.get(package)?;
        let is_cheap = CHEAP.iter().any(|name| package.split(' ').next() == Some(name));
        (!is_cheap && !own.is_subset(other)).then(|| format!("{package}: {own:?} for {build}, {other:?} for {other_build}"))
    };
    features.iter().filter_map(differs).collect()
}

/// The features of every package that a selection of packages is built from.
fn features(selection: &[&str]) -> Result<Features> {
    let words = ["tree", "--locked", "--target=x86_64-unknown-linux-gnu", "--prefix=none", "--format={p}|{f}"];
    let tree = read(command("cargo", words).args(selection))?;
    let mut features = Features::new();
    // Lines such as `syn v2.0.119 (proc-macro)|default,full (*)`.
    for (package, own) in tree.lines().filter_map(|line| line.trim_end_matches(" (*)").split_once('|')) {
        let name = package.splitn(3, ' ').take(2).collect::<Vec<_>>().join(" ");
        features.entry(name).or_default().insert(own.to_owned());
    }
    Ok(features)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_with_other_features_are_named() {
        let features = |list: &[(&str, &str)]| -> Features {
            list.iter().map(|(package, features)| (package.to_string(), [features.to_string()].into())).collect()
        };
        let all = features(&[("a v1", "x,y"), ("b v1", ""), ("multiscopic-drivers v0", "x")]);
        let own = features(&[("a v1", "x"), ("b v1", ""), ("c v1", ""), ("multiscopic-drivers v0", "")]);
        assert_eq!(differences("one", &own, "all", &all), [r#"a v1: {"x"} for one, {"x,y"} for all"#]);
    }
}
