//! The imports of a crate: which file uses items that another file defines. Paths are followed through modules, imports and
//! re-exports.

use proc_macro2::{TokenStream, TokenTree};
use std::{
    collections::{HashMap, HashSet},
    fmt,
};
use syn::{
    Attribute, Ident, Item, ItemUse, Macro, Path, UseTree, Visibility,
    ext::IdentExt,
    visit::{self, Visit},
};

use super::crate_tree::{CrateTree, ModuleId};

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

/// The target of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Target {
    Module(ModuleId),
    /// An item that this module defines, or a part of one, such as a variant.
    Item(ModuleId),
}

/// One import of a `use` declaration.
#[derive(Clone, Debug)]
struct Import {
    path: Vec<String>,
    /// The name it gets; `None` for a glob import.
    name: Option<String>,
    is_reexport: bool,
}

/// The names in a module.
#[derive(Default)]
struct Scope {
    definitions: HashSet<String>,
    /// The identifiers in macro invocations, which may define items of these names.
    expanded: HashSet<String>,
    imports: HashMap<String, Vec<Vec<String>>>,
    globs: Vec<Vec<String>>,
}

/// The names in each module of a crate.
struct Resolver<'a> {
    tree: &'a CrateTree,
    scopes: Vec<Scope>,
    /// The module that defines each macro. Macros are in scope by their position in the text, not by path.
    macros: HashMap<String, ModuleId>,
}

impl<'a> Resolver<'a> {
    fn new(tree: &'a CrateTree) -> Resolver<'a> {
        let mut resolver = Resolver { tree, scopes: Vec::new(), macros: HashMap::new() };
        for (id, module) in tree.modules.iter().enumerate() {
            let mut scope = Scope::default();
            for item in &module.items {
                match item {
                    Item::Use(item) => scope.add(imports(item)),
                    Item::Macro(item) => match &item.ident {
                        Some(name) => drop(resolver.macros.insert(text(name), id)),
                        None => identifiers(item.mac.tokens.clone(), &mut scope.expanded),
                    },
                    _ => scope.definitions.extend(defined_name(item).map(text)),
                }
            }
            resolver.scopes.push(scope);
        }
        resolver
    }

    /// Returns the targets of `path` in `module`. There are several if a type and a function share the name, or if it depends
    /// on the platform; none if it leads out of the crate.
    fn resolve(&self, module: ModuleId, path: &[String]) -> HashSet<Target> {
        self.follow(module, path, &mut HashSet::new())
    }

    /// The module that defines the macro `name`.
    fn defining_module_of_macro(&self, name: &str) -> Option<ModuleId> {
        self.macros.get(name).copied()
    }

    fn follow(&self, module: ModuleId, path: &[String], visited: &mut HashSet<(ModuleId, String)>) -> HashSet<Target> {
        let Some((first, rest)) = path.split_first() else { return HashSet::new() };
        let mut targets = match first.as_str() {
            "crate" => HashSet::from([Target::Module(0)]),
            "self" => HashSet::from([Target::Module(module)]),
            "super" => self.tree.modules[module].parent.map(Target::Module).into_iter().collect(),
            name => self.look_up(module, name, visited),
        };
        for name in rest {
            let step = |target: Target| match target {
                Target::Module(id) if name == "super" => self.tree.modules[id].parent.map(Target::Module).into_iter().collect(),
                Target::Module(id) => {
                    let found = self.look_up(id, name, visited);
                    let is_expanded = found.is_empty() && self.scopes[id].expanded.contains(name);
                    if is_expanded { HashSet::from([Target::Item(id)]) } else { found }
                }
                Target::Item(_) => HashSet::from([target]),
            };
            targets = targets.into_iter().flat_map(step).collect();
        }
        targets
    }

    fn look_up(&self, module: ModuleId, name: &str, visited: &mut HashSet<(ModuleId, String)>) -> HashSet<Target> {
        if !visited.insert((module, name.into())) {
            return HashSet::new();
        }
        let scope = &self.scopes[module];
        let mut targets: HashSet<Target> = self.tree.child(module, name).map(Target::Module).into_iter().collect();
        if scope.definitions.contains(name) {
            targets.insert(Target::Item(module));
        }
        for path in scope.imports.get(name).into_iter().flatten() {
            targets.extend(self.follow(module, path, visited));
        }
        if targets.is_empty() && scope.imports.contains_key(name) {
            // What another crate defines counts as the module's own.
            targets.insert(Target::Item(module));
        }
        if targets.is_empty() && module == 0 {
            // Exported macros are in the crate's root.
            targets.extend(self.macros.get(name).copied().map(Target::Item));
        }
        if targets.is_empty() {
            for path in &scope.globs {
                for target in self.follow(module, path, visited) {
                    if let Target::Module(id) = target {
                        targets.extend(self.look_up(id, name, visited));
                    }
                }
            }
        }
        visited.remove(&(module, name.into()));
        targets
    }
}

impl Scope {
    fn add(&mut self, imports: Vec<Import>) {
        for Import { path, name, .. } in imports {
            match name {
                Some(name) => self.imports.entry(name).or_default().push(path),
                None => self.globs.push(path),
            }
        }
    }
}

/// The imports of a `use` declaration.
fn imports(item: &ItemUse) -> Vec<Import> {
    let mut found = Vec::new();
    // A path that begins with `::` leads out of the crate.
    if item.leading_colon.is_none() {
        collect(&item.tree, &mut Vec::new(), !matches!(item.vis, Visibility::Inherited), &mut found);
    }
    found
}

fn collect(tree: &UseTree, prefix: &mut Vec<String>, is_reexport: bool, found: &mut Vec<Import>) {
    let mut add = |last: Option<&Ident>, name: Option<String>| {
        let last = last.map(text).filter(|last| last != "self");
        found.push(Import { path: prefix.iter().cloned().chain(last).collect(), name, is_reexport });
    };
    match tree {
        UseTree::Name(leaf) if leaf.ident == "self" => add(None, prefix.last().cloned()),
        UseTree::Name(leaf) => add(Some(&leaf.ident), Some(text(&leaf.ident))),
        UseTree::Rename(leaf) => add(Some(&leaf.ident), Some(text(&leaf.rename))),
        UseTree::Glob(_) => add(None, None),
        UseTree::Group(group) => group.items.iter().for_each(|tree| collect(tree, prefix, is_reexport, found)),
        UseTree::Path(path) => {
            prefix.push(text(&path.ident));
            collect(&path.tree, prefix, is_reexport, found);
            prefix.pop();
        }
    }
}

/// Collects the identifiers among tokens.
fn identifiers(tokens: TokenStream, found: &mut HashSet<String>) {
    for token in tokens {
        match token {
            TokenTree::Ident(ident) => drop(found.insert(text(&ident))),
            TokenTree::Group(group) => identifiers(group.stream(), found),
            _ => {}
        }
    }
}

/// A name without the prefix `r#` of raw identifiers.
fn text(ident: &Ident) -> String {
    ident.unraw().to_string()
}

fn defined_name(item: &Item) -> Option<&Ident> {
    match item {
        Item::Const(item) => Some(&item.ident),
        Item::Enum(item) => Some(&item.ident),
        Item::Fn(item) => Some(&item.sig.ident),
        Item::Static(item) => Some(&item.ident),
        Item::Struct(item) => Some(&item.ident),
        Item::Trait(item) => Some(&item.ident),
        Item::TraitAlias(item) => Some(&item.ident),
        Item::Type(item) => Some(&item.ident),
        Item::Union(item) => Some(&item.ident),
        _ => None,
    }
}

/// A violation of a rule.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Violation {
    /// The file or folder, relative to the workspace.
    pub place: String,
    /// The violation in words.
    pub message: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.message)
    }
}
