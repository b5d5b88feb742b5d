//! Random inputs for tests, counted by what came of them.

use std::{cell::RefCell, collections::BTreeMap};

use proptest::{
    strategy::Strategy,
    test_runner::{Config, TestCaseError, TestRunner},
};

/// Tries `cases` random inputs, or more if `PROPTEST_CASES` asks for them, and returns how many of them had each outcome.
///
/// # Panics
/// For an input that `outcome` fails for or panics at, with the smallest such input.
pub fn tally<S: Strategy>(
    cases: u32,
    inputs: &S,
    outcome: impl Fn(S::Value) -> Result<&'static str, TestCaseError>,
) -> BTreeMap<&'static str, u64> {
    let counts = RefCell::new(BTreeMap::new());
    let default = Config::default();
    let config = Config { cases: default.cases.max(cases), failure_persistence: None, ..default };
    TestRunner::new(config)
        .run(inputs, |input| {
            let outcome = outcome(input)?;
            *counts.borrow_mut().entry(outcome).or_insert(0) += 1;
            Ok(())
        })
        .unwrap_or_else(|error| panic!("{error}"));
    let counts = counts.into_inner();
    println!("{counts:?}");
    counts
}
