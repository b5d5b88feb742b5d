//! The committed record of instructions per disparity evaluation, which guards against slowdowns without
//! measuring time.

use anyhow::{Context, Result, ensure};
use std::{collections::BTreeMap, fs};

use crate::system::folders;

/// Its path in the workspace.
const PATH: &str = "tests/benches/instructions.json";

/// The largest deviation from the record in percent, which leaves room for another version of the compiler.
const TOLERANCE: f64 = 5.0;

/// Instructions per disparity evaluation, by the name of the run.
pub type Counts = BTreeMap<String, f64>;

/// Compares `counts` with the record, or writes them to it on `update`. Failures suggest `command` for that.
pub fn hold(counts: &Counts, update: bool, command: &str) -> Result<()> {
    let path = folders::root().join(PATH);
    let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut record: Counts = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
    if update {
        record.extend(counts.iter().map(|(name, counted)| (name.clone(), (counted * 1e3).round() / 1e3)));
        let text = serde_json::to_string_pretty(&record)? + "\n";
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
        println!("instructions: {} counts written to {PATH}", counts.len());
        return Ok(());
    }
    let wrong: Vec<String> = counts.iter().filter_map(|(name, &counted)| verdict(name, counted, record.get(name))).collect();
    for line in &wrong {
        eprintln!("instructions: {line}");
    }
    ensure!(
        wrong.is_empty(),
        "{} of {} counts are more than {TOLERANCE} % off {PATH}; if that is meant, `{command}` records it",
        wrong.len(),
        counts.len()
    );
    println!("instructions: {} counts are within {TOLERANCE} % of {PATH}", counts.len());
    Ok(())
}

/// What is wrong with a count. Counts far below the record are wrong too, so that the record stays accurate.
fn verdict(name: &str, counted: f64, recorded: Option<&f64>) -> Option<String> {
    let Some(recorded) = recorded else { return Some(format!("{name}: counted {counted:.3}, nothing recorded")) };
    let change = 100.0 * (counted / recorded - 1.0);
    (change.abs() > TOLERANCE)
        .then(|| format!("{name}: counted {counted:.3}, recorded {recorded:.3}: {change:+.1} % instructions per evaluation"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_above_and_below_the_record_fail() {
        assert_eq!(verdict("a", 1.04, Some(&1.0)), None);
        assert_eq!(verdict("a", 0.96, Some(&1.0)), None);
        let more = "a: counted 1.100, recorded 1.000: +10.0 % instructions per evaluation";
        assert_eq!(verdict("a", 1.1, Some(&1.0)).as_deref(), Some(more));
        let less = "a: counted 0.900, recorded 1.000: -10.0 % instructions per evaluation";
        assert_eq!(verdict("a", 0.9, Some(&1.0)).as_deref(), Some(less));
        assert_eq!(verdict("a", 1.0, None).as_deref(), Some("a: counted 1.000, nothing recorded"));
    }
}
