//! The workspace's architecture: imports between a crate's top-level modules run one way, and files form no circles.
//!
//! The check parses every source file and follows every path in it, through modules and re-exports, to the
//! file that defines the item. Code for unit tests (`#[cfg(test)]`) may import anything.

mod circles;
mod crate_tree;
mod imports;
mod layers;
mod resolution;
mod violation;
mod workspace;

use std::{error::Error, path::Path};

pub use violation::Violation;

use crate_tree::CrateTree;
use workspace::{CrateRoot, Use};

/// All violations in the workspace at `root`, sorted.
///
/// # Errors
/// If cargo cannot list the workspace's crates, or a source file cannot be read or parsed.
pub fn check(root: &Path) -> Result<Vec<Violation>, Box<dyn Error>> {
    check_crates(root, &workspace::crate_roots(root)?)
}

fn check_crates(root: &Path, crate_roots: &[CrateRoot]) -> Result<Vec<Violation>, Box<dyn Error>> {
    let mut violations = Vec::new();
    for crate_root in crate_roots {
        let tree = CrateTree::read(root, &crate_root.path)?;
        let imports = imports::of(&tree);
        violations.extend(imports.unresolved);
        violations.extend(layers::check(&tree, &imports.edges, crate_root.usage == Use::Library));
        violations.extend(circles::check(&tree, &imports.edges));
    }
    violations.sort();
    violations.dedup();
    Ok(violations)
}

#[cfg(test)]
mod tests;
