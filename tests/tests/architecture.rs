//! The workspace keeps its architecture. `cargo xtask architecture` prints the violations.

use std::path::Path;

use multiscopic_tests::architecture;

#[test]
fn the_workspace_keeps_its_architecture() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests are a folder of the workspace");
    let violations = architecture::check(root).expect("the sources can be read");
    let lines: Vec<String> = violations.iter().map(ToString::to_string).collect();
    assert!(violations.is_empty(), "{} violations:\n{}", lines.len(), lines.join("\n"));
}
