//! The programs in docs/many-machines.md.

use anyhow::{Context, Result};
use std::fs;

use crate::system::folders;

const GUIDE: &str = "docs/many-machines.md";

/// The block of code in the guide that contains some words.
pub fn block(words: &str) -> Result<String> {
    let text = fs::read_to_string(folders::root().join(GUIDE)).with_context(|| format!("cannot read {GUIDE}"))?;
    let blocks = text.split("```").skip(1).step_by(2).filter_map(|block| Some(block.split_once('\n')?.1));
    let found = blocks.map(str::to_owned).find(|block| block.contains(words));
    found.with_context(|| format!("{GUIDE} has no block of code with {words}"))
}
