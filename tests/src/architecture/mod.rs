//! The workspace's architecture: imports between a crate's top-level modules run one way, and files form no circles.
//!
//! The check parses every source file and follows every path in it, through modules and re-exports, to the
//! file that defines the item. Code for unit tests (`#[cfg(test)]`) may import anything.

mod crate_tree;
mod imports;

use petgraph::{
    algo::{astar, tarjan_scc},
    graph::{DiGraph, NodeIndex},
};
use std::{
    collections::BTreeMap,
    env,
    error::Error,
    path::{Path, PathBuf},
    process::Command,
};

use self::{
    crate_tree::{CrateTree, ModuleId, text},
    imports::Edge,
};

pub use self::imports::Violation;

/// All violations in the workspace at `root`, sorted.
///
/// # Errors
/// If cargo cannot list the workspace's crates, or a source file cannot be read or parsed.
pub fn check(root: &Path) -> Result<Vec<Violation>, Box<dyn Error>> {
    check_crates(root, &crate_roots(root)?)
}

fn check_crates(root: &Path, crate_roots: &[CrateRoot]) -> Result<Vec<Violation>, Box<dyn Error>> {
    let mut violations = Vec::new();
    for crate_root in crate_roots {
        let tree = CrateTree::read(root, &crate_root.path)?;
        let imports = imports::of(&tree);
        violations.extend(imports.unresolved);
        violations.extend(check_layers(&tree, &imports.edges, crate_root.usage == Use::Library));
        violations.extend(check_circles(&tree, &imports.edges));
    }
    violations.sort();
    violations.dedup();
    Ok(violations)
}

/// The kind of a crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// A library, which must list its modules.
    Library,
    /// A program.
    Program,
    /// Integration tests, examples and benchmarks.
    Test,
}

/// The root file of a crate.
#[derive(Clone, Debug)]
struct CrateRoot {
    path: PathBuf,
    usage: Use,
}

/// Lists the crates of the workspace at `root`, except build scripts and generated bindings.
fn crate_roots(root: &Path) -> Result<Vec<CrateRoot>, Box<dyn Error>> {
    let cargo = env::var_os("CARGO").unwrap_or("cargo".into());
    let listed =
        Command::new(cargo).args(["metadata", "--no-deps", "--offline", "--format-version", "1"]).current_dir(root).output()?;
    if !listed.status.success() {
        return Err(format!("cargo metadata failed: {}", String::from_utf8_lossy(&listed.stderr)).into());
    }
    let metadata: serde_json::Value = serde_json::from_slice(&listed.stdout)?;
    let packages = metadata["packages"].as_array().into_iter().flatten();
    let ours = packages.filter(|package| !package["name"].as_str().is_some_and(|name| name.ends_with("-sys-mit")));
    let targets = ours.flat_map(|package| package["targets"].as_array().into_iter().flatten());
    Ok(targets.filter_map(crate_root).collect())
}

fn crate_root(target: &serde_json::Value) -> Option<CrateRoot> {
    let usage = match target["kind"][0].as_str()? {
        "lib" | "rlib" | "cdylib" => Use::Library,
        "bin" => Use::Program,
        "test" | "example" | "bench" => Use::Test,
        _ => return None,
    };
    Some(CrateRoot { path: target["src_path"].as_str()?.into(), usage })
}

/// The header of the table of modules in the crate's documentation.
const HEAD: [&str; 2] = ["module", "what it is"];

/// Compares the imports with the crate's table of modules, which libraries must have: a module may import only from those before
/// it.
fn check_layers(tree: &CrateTree, edges: &[Edge], must_list_modules: bool) -> Vec<Violation> {
    let root = &tree.modules[0];
    let place = tree.place(root.file);
    let violation = |message: String| Violation { place: place.clone(), message };
    let name = |module: ModuleId| tree.modules[module].name.as_str();
    let documentation: Vec<String> = root.attributes.iter().filter(|a| a.path().is_ident("doc")).filter_map(text).collect();
    let Some(listed) = listed_modules(&documentation) else {
        let message = format!("its documentation has no table `| {} |` of its modules", HEAD.join(" | "));
        return if must_list_modules && !root.children.is_empty() { vec![violation(message)] } else { Vec::new() };
    };

    let mut violations = Vec::new();
    let rank = |module: ModuleId| listed.iter().position(|listed| listed == name(module));
    for (i, listed_name) in listed.iter().enumerate() {
        if tree.child(0, listed_name).is_none() {
            violations.push(violation(format!("the module `{listed_name}` is listed, but there is no such module")));
        }
        if listed[..i].contains(listed_name) {
            violations.push(violation(format!("the module `{listed_name}` is listed twice")));
        }
    }
    for &module in root.children.iter().filter(|&&module| rank(module).is_none()) {
        violations.push(violation(format!("the module `{}` is not listed", name(module))));
    }
    for Edge { from, to, path } in edges {
        let Some(source) = tree.top_level(*from) else { continue };
        let message = match tree.top_level(*to) {
            None => format!("imports {path} from the crate's root, which is above all modules"),
            Some(target) if rank(source) < rank(target) && rank(source).is_some() => {
                format!("imports {path} from the module `{}`, which is listed after `{}`", name(target), name(source))
            }
            Some(_) => continue,
        };
        violations.push(Violation { place: tree.place(tree.modules[*from].file), message });
    }
    violations
}

/// The modules in the first column of the table in `documentation`, in their order; `None` if there is no table.
fn listed_modules(documentation: &[String]) -> Option<Vec<String>> {
    let cells = |line: &str| -> Option<Vec<String>> {
        let line = line.trim().strip_prefix('|')?.strip_suffix('|')?;
        Some(line.split('|').map(|cell| cell.trim().to_owned()).collect())
    };
    let lines: Vec<&str> = documentation.iter().flat_map(|text| text.lines()).collect();
    let head = lines.iter().position(|line| cells(line).is_some_and(|cells| cells == HEAD))?;
    // The second line separates the header from the rows.
    let rows = lines[head..].iter().skip(2).map_while(|line| cells(line)?.into_iter().next());
    Some(rows.flat_map(|cell| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>()).collect())
}

/// Finds groups of files that depend on each other, and the shortest circle through the first file of each.
fn check_circles(tree: &CrateTree, edges: &[Edge]) -> Vec<Violation> {
    let mut graph: DiGraph<(), &str> = DiGraph::new();
    for _ in &tree.files {
        graph.add_node(());
    }
    let file = |module: usize| NodeIndex::new(tree.modules[module].file);
    for edge in edges {
        graph.update_edge(file(edge.from), file(edge.to), &edge.path);
    }
    let groups = tarjan_scc(&graph).into_iter().filter(|group| group.len() > 1);
    let violations = groups.map(|group| {
        let places: BTreeMap<String, NodeIndex> = group.iter().map(|&node| (tree.place(node.index()), node)).collect();
        let (place, &first) = places.first_key_value().expect("a group has files");
        let ways = graph.neighbors(first).filter(|next| group.contains(next));
        let way_back = |next| astar(&graph, next, |node| node == first, |_| 1, |_| 0);
        let (_, circle) = ways.filter_map(way_back).min_by_key(|(length, _)| *length).expect("each file of a group leads back");
        let mut steps = vec![first];
        steps.extend(circle);
        let describe = |pair: &[NodeIndex]| {
            let path = graph.find_edge(pair[0], pair[1]).map_or("", |edge| graph[edge]);
            format!("imports {path} of {}", tree.place(pair[1].index()))
        };
        let steps: Vec<String> = steps.windows(2).map(describe).collect();
        let message = format!("is in a circle of {} files: it {}", group.len(), steps.join(", which "));
        Violation { place: place.clone(), message }
    });
    violations.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    use std::fs;

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
        let roots: Vec<_> =
            roots.iter().map(|(name, usage)| CrateRoot { path: folder.path().join(name), usage: *usage }).collect();
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
        assert_eq!(
            messages(&[("lib.rs", &root), ("low.rs", "pub struct A; use crate::B;"), ("high.rs", "pub struct B;")]),
            [upward]
        );
        assert_eq!(
            messages(&[("lib.rs", &root), ("low.rs", "pub struct A;"), ("high.rs", "pub struct B; use crate::A;")]),
            [""; 0]
        );
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
        assert_eq!(
            messages(&[("lib.rs", &without), ("low.rs", ""), ("high.rs", "")]),
            ["lib.rs: the module `high` is not listed"]
        );
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
        let found = messages(&inner(
            "mod first; mod second;",
            "use super::second::B; pub struct A;",
            "use super::first::A; pub struct B;",
        ));
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
        let found =
            messages(&inner("mod first; mod second; pub struct M; fn f(_: first::A) {}", "use super::M; pub struct A;", ""));
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
        const ROOT: &str =
            "//! | module | what it is |\n//! | - | - |\n//! | `low` | |\n//! | `match` | |\nmod low;\nmod r#match;";
        let found = messages(&[("lib.rs", ROOT), ("low.rs", "use crate::r#match::B;"), ("match.rs", "pub struct B;")]);
        assert_eq!(found, ["low.rs: imports crate::match::B from the module `match`, which is listed after `low`"]);
    }

    #[test]
    fn items_that_macros_define_are_found() {
        let high = "macro_rules! define { ($name:ident) => { pub fn $name() {} } } define!(B);";
        assert_eq!(messages(&modules("fn f() { crate::high::B(); }", high)), [UPWARD]);
        assert_eq!(messages(&modules("fn f() { crate::high::C(); }", high)), ["low.rs: the path crate::high::C leads nowhere"]);
    }
}
