//! The imports of a crate: which file uses items that another file defines.

use std::collections::HashSet;

use proc_macro2::{TokenStream, TokenTree};
use syn::{
    Attribute, ItemUse, Macro, Path, Visibility,
    visit::{self, Visit},
};

use super::{
    crate_tree::{CrateTree, ModuleId},
    resolution::{Resolver, Target, imports, text},
    violation::Violation,
};

/// A use of an item that another file defines.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Edge {
    pub from: ModuleId,
    pub to: ModuleId,
    /// The path as it is written.
    pub path: String,
}

/// A crate's imports.
#[derive(Debug)]
pub(super) struct Imports {
    pub edges: Vec<Edge>,
    /// Paths within the crate that could not be followed. They are violations, since the check is blind to
    /// them.
    pub unresolved: Vec<Violation>,
}

/// Collects every use in `tree` of an item that another file defines.
///
/// Declaring child modules and re-exporting from them are not imports. Naming a module is not one either;
/// naming an item in it is.
pub(super) fn of(tree: &CrateTree) -> Imports {
    let resolver = Resolver::new(tree);
    let mut visitor = Visitor { tree, resolver: &resolver, module: 0, edges: HashSet::new(), unresolved: HashSet::new() };
    for (id, module) in tree.modules.iter().enumerate() {
        visitor.module = id;
        module.items.iter().for_each(|item| visitor.visit_item(item));
    }
    let mut edges: Vec<Edge> = visitor.edges.into_iter().collect();
    edges.sort();
    Imports { edges, unresolved: visitor.unresolved.into_iter().map(|(place, message)| Violation { place, message }).collect() }
}

struct Visitor<'a> {
    tree: &'a CrateTree,
    resolver: &'a Resolver<'a>,
    module: ModuleId,
    edges: HashSet<Edge>,
    unresolved: HashSet<(String, String)>,
}

impl Visitor<'_> {
    fn add(&mut self, to: ModuleId, path: &[String]) {
        if self.tree.modules[self.module].file != self.tree.modules[to].file {
            self.edges.insert(Edge { from: self.module, to, path: path.join("::") });
        }
    }

    /// Resolves a path, and notes it if it leads nowhere.
    fn resolve(&mut self, path: &[String]) -> HashSet<Target> {
        let targets = self.resolver.resolve(self.module, path);
        let is_internal = path.first().is_some_and(|first| ["crate", "self", "super"].contains(&first.as_str()));
        if targets.is_empty() && is_internal && path.len() > 1 {
            let place = self.tree.place(self.tree.modules[self.module].file);
            self.unresolved.insert((place, format!("the path {} leads nowhere", path.join("::"))));
        }
        targets
    }

    fn name(&mut self, path: &[String]) {
        for target in self.resolve(path) {
            if let Target::Item(module) = target {
                self.add(module, path);
            }
        }
    }

    /// Finds paths among the tokens of a macro.
    fn scan(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let is = |i: usize, wanted: char| matches!(tokens.get(i), Some(TokenTree::Punct(found)) if found.as_char() == wanted);
        let mut i = 0;
        while i < tokens.len() {
            match &tokens[i] {
                TokenTree::Group(group) => self.scan(group.stream()),
                // Skip fields, methods, and variables of the macro.
                TokenTree::Ident(ident) if i > 0 && (is(i - 1, '.') || is(i - 1, '$') && ident != "crate") => {}
                TokenTree::Ident(first) => {
                    let mut path = vec![text(first)];
                    while is(i + 1, ':') && is(i + 2, ':') {
                        let Some(TokenTree::Ident(next)) = tokens.get(i + 3) else { break };
                        path.push(text(next));
                        i += 3;
                    }
                    let is_macro = is(i + 1, '!') && matches!(tokens.get(i + 2), Some(TokenTree::Group(_)));
                    if is_macro && path.len() == 1 {
                        self.invoke(&path);
                    } else {
                        self.name(&path);
                    }
                }
                _ => {}
            }
            i += 1;
        }
    }

    fn invoke(&mut self, path: &[String]) {
        match self.resolver.defining_module_of_macro(&path[path.len() - 1]) {
            Some(module) => self.add(module, path),
            None => self.name(path),
        }
    }
}

impl<'ast> Visit<'ast> for Visitor<'_> {
    fn visit_item_use(&mut self, item: &'ast ItemUse) {
        for import in imports(item) {
            for target in self.resolve(&import.path) {
                let (Target::Module(module) | Target::Item(module)) = target;
                let is_own = import.is_reexport && self.tree.is_within(module, self.module);
                let is_named = matches!(target, Target::Item(_)) || import.is_reexport;
                if is_named && !is_own {
                    self.add(module, &import.path);
                }
            }
        }
    }

    fn visit_path(&mut self, path: &'ast Path) {
        if path.leading_colon.is_none() {
            let segments: Vec<String> = path.segments.iter().map(|segment| text(&segment.ident)).collect();
            self.name(&segments);
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, invocation: &'ast Macro) {
        let path: Vec<String> = invocation.path.segments.iter().map(|segment| text(&segment.ident)).collect();
        self.invoke(&path);
        self.scan(invocation.tokens.clone());
    }

    fn visit_visibility(&mut self, _: &'ast Visibility) {}

    fn visit_attribute(&mut self, _: &'ast Attribute) {}
}
