use std::fs;

use super::*;

/// The messages about a library of these files, each after its place.
fn messages(files: &[(&str, &str)]) -> Vec<String> {
    messages_of(files, &[("lib.rs", Use::Library)])
}

fn messages_of(files: &[(&str, &str)], roots: &[(&str, Use)]) -> Vec<String> {
    let folder = tempfile::tempdir().expect("a folder for a test");
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().expect("a file in a folder")).expect("a folder for a test");
        fs::write(path, text).expect("a file for a test");
    }
    let roots: Vec<_> = roots.iter().map(|(name, usage)| CrateRoot { path: folder.path().join(name), usage: *usage }).collect();
    let violations = check_crates(folder.path(), &roots).expect("the files can be parsed");
    violations.iter().map(ToString::to_string).collect()
}

/// Modules `low` and `high`, in this order.
const MODULES: &str =
    "//! | module | what it is |\n//! | --- | --- |\n//! | [`low`] | first |\n//! | `high` | second |\nmod high;\nmod low;\n";

fn modules<'a>(low: &'a str, high: &'a str) -> [(&'a str, &'a str); 3] {
    [("lib.rs", MODULES), ("low.rs", low), ("high.rs", high)]
}

const UPWARD: &str = "low.rs: imports crate::high::B from the module `high`, which is listed after `low`";

#[test]
fn imports_down_the_table_pass() {
    assert_eq!(messages(&modules("pub struct A;", "use crate::low::A; fn f(_: A) {}")), [""; 0]);
}

#[test]
fn imports_up_the_table_fail() {
    assert_eq!(messages(&modules("use crate::high::B;", "pub struct B;")), [UPWARD]);
}

#[test]
fn paths_without_a_use_count() {
    assert_eq!(messages(&modules("fn f() { crate::high::B; }", "pub struct B;")), [UPWARD]);
    assert_eq!(messages(&modules("fn f(_: Option<crate::high::B>) {}", "pub struct B;")), [UPWARD]);
    let relative = UPWARD.replace("crate::", "super::");
    assert_eq!(messages(&modules("fn f() { super::high::B; }", "pub struct B;")), [relative]);
    let by_module = UPWARD.replace("crate::", "");
    assert_eq!(messages(&modules("use crate::high; fn f() { high::B; }", "pub struct B;")), [by_module]);
}

#[test]
fn paths_in_macros_count() {
    assert_eq!(messages(&modules("fn f() { println!(\"{}\", crate::high::B); }", "pub const B: u8 = 1;")), [UPWARD]);
    assert_eq!(messages(&modules("macro_rules! b { () => { $crate::high::B } }", "pub const B: u8 = 1;")), [UPWARD]);
    let invoked = "low.rs: imports b from the module `high`, which is listed after `low`";
    assert_eq!(messages(&modules("fn f() { b!(); }", "macro_rules! b { () => {} }")), [invoked]);
}

#[test]
fn variants_are_imports_of_their_type() {
    let variant = UPWARD.replace("high::B", "high::B::C");
    assert_eq!(messages(&modules("use crate::high::B::C;", "pub enum B { C }")), [variant]);
}

#[test]
fn reexports_are_followed_to_the_definition() {
    let root = format!("{MODULES}pub use high::B;\npub use low::A;\n");
    let upward = UPWARD.replace("high::B", "B");
    assert_eq!(messages(&[("lib.rs", &root), ("low.rs", "pub struct A; use crate::B;"), ("high.rs", "pub struct B;")]), [upward]);
    assert_eq!(messages(&[("lib.rs", &root), ("low.rs", "pub struct A;"), ("high.rs", "pub struct B; use crate::A;")]), [""; 0]);
    // Through two globs.
    let root = format!("{MODULES}pub use high::*;\n");
    let upward = UPWARD.replace("crate::high::B", "B");
    let low = "use crate::*; fn f(_: B) {}";
    assert_eq!(messages(&[("lib.rs", &root), ("low.rs", low), ("high.rs", "pub struct B;")]), [upward]);
}

#[test]
fn a_module_may_not_reexport_from_a_later_one() {
    assert_eq!(messages(&modules("pub use crate::high::B;", "pub struct B;")), [UPWARD]);
}

#[test]
fn tests_may_import_anything() {
    assert_eq!(messages(&modules("#[cfg(test)] mod tests { use crate::high::B; }", "pub struct B;")), [""; 0]);
    assert_eq!(messages(&modules("#[cfg(test)] use crate::high::B;", "pub struct B;")), [""; 0]);
    assert_eq!(messages(&modules("#[cfg(not(test))] use crate::high::B;", "pub struct B;")), [UPWARD]);
}

#[test]
fn the_root_is_above_all_modules() {
    let root = format!("{MODULES}pub struct R;\n");
    let message = "low.rs: imports crate::R from the crate's root, which is above all modules";
    let found = messages(&[("lib.rs", &root), ("low.rs", "use crate::R;"), ("high.rs", "")]);
    assert!(found.contains(&message.to_owned()), "{found:?}");
}

#[test]
fn a_table_lists_each_module_once() {
    let without = MODULES.replace("//! | `high` | second |\n", "");
    assert_eq!(messages(&[("lib.rs", &without), ("low.rs", ""), ("high.rs", "")]), ["lib.rs: the module `high` is not listed"]);
    let more = MODULES.replace("`high`", "`high`, `attic`, [`low`]");
    let expected =
        ["lib.rs: the module `attic` is listed, but there is no such module", "lib.rs: the module `low` is listed twice"];
    assert_eq!(messages(&[("lib.rs", &more), ("low.rs", ""), ("high.rs", "")]), expected);
}

#[test]
fn a_library_has_a_table() {
    let expected = ["lib.rs: its documentation has no table `| module | what it is |` of its modules"];
    assert_eq!(messages(&[("lib.rs", "//! A library.\nmod low;"), ("low.rs", "")]), expected);
    assert_eq!(messages(&[("lib.rs", "//! A library without modules.")]), [""; 0]);
    assert_eq!(messages_of(&[("main.rs", "mod low;"), ("low.rs", "")], &[("main.rs", Use::Program)]), [""; 0]);
}

/// A module with two files.
fn inner<'a>(module: &'a str, first: &'a str, second: &'a str) -> [(&'a str, &'a str); 4] {
    const ROOT: &str = "//! | module | what it is |\n//! | --- | --- |\n//! | `inner` | all |\nmod inner;\n";
    [("lib.rs", ROOT), ("inner/mod.rs", module), ("inner/first.rs", first), ("inner/second.rs", second)]
}

#[test]
fn circles_of_files_fail() {
    let found =
        messages(&inner("mod first; mod second;", "use super::second::B; pub struct A;", "use super::first::A; pub struct B;"));
    let circle = "is in a circle of 2 files: it imports super::second::B of inner/second.rs, \
                  which imports super::first::A of inner/first.rs";
    assert_eq!(found, [format!("inner/first.rs: {circle}")]);
}

#[test]
fn reexports_of_children_make_no_circle() {
    let module = "mod first; mod second; pub use first::A; pub use second::B;";
    assert_eq!(messages(&inner(module, "pub struct A;", "use super::A; pub struct B;")), [""; 0]);
}

#[test]
fn a_module_and_its_child_may_not_use_each_other() {
    let found = messages(&inner("mod first; mod second; pub struct M; fn f(_: first::A) {}", "use super::M; pub struct A;", ""));
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].starts_with("inner/first.rs: is in a circle of 2 files"), "{found:?}");
    // Also when the module names what it re-exports.
    let module = "mod first; mod second; pub use first::A; pub struct M; fn f(_: A) {}";
    assert_eq!(messages(&inner(module, "use super::M; pub struct A;", "")).len(), 1);
    // The child alone may.
    assert_eq!(messages(&inner("mod first; mod second; pub struct M;", "use super::M;", "")), [""; 0]);
}

#[test]
fn paths_that_lead_nowhere_are_reported() {
    let expected = ["low.rs: the path crate::attic::B leads nowhere"];
    assert_eq!(messages(&modules("use crate::attic::B;", "")), expected);
}

#[test]
fn raw_names_are_followed() {
    const ROOT: &str = "//! | module | what it is |\n//! | - | - |\n//! | `low` | |\n//! | `match` | |\nmod low;\nmod r#match;";
    let found = messages(&[("lib.rs", ROOT), ("low.rs", "use crate::r#match::B;"), ("match.rs", "pub struct B;")]);
    assert_eq!(found, ["low.rs: imports crate::match::B from the module `match`, which is listed after `low`"]);
}

#[test]
fn items_that_macros_define_are_found() {
    let high = "macro_rules! define { ($name:ident) => { pub fn $name() {} } } define!(B);";
    assert_eq!(messages(&modules("fn f() { crate::high::B(); }", high)), [UPWARD]);
    assert_eq!(messages(&modules("fn f() { crate::high::C(); }", high)), ["low.rs: the path crate::high::C leads nowhere"]);
}
