//! Layers: a crate's top-level modules may import only from modules that its documentation lists before them.

use super::{
    crate_tree::{CrateTree, ModuleId, text},
    imports::Edge,
    violation::Violation,
};

/// The header of the table of modules in the crate's documentation.
const HEAD: [&str; 2] = ["module", "what it is"];

/// Compares the imports with the crate's table of modules, which libraries must have.
pub(super) fn check(tree: &CrateTree, edges: &[Edge], must_list_modules: bool) -> Vec<Violation> {
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
