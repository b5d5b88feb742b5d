//! Resolution of paths: looks names up in modules and follows imports and re-exports.

use std::collections::{HashMap, HashSet};

use proc_macro2::{TokenStream, TokenTree};
use syn::{Ident, Item, ItemUse, UseTree, Visibility, ext::IdentExt};

use super::crate_tree::{CrateTree, ModuleId};

/// The target of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Target {
    Module(ModuleId),
    /// An item that this module defines, or a part of one, such as a variant.
    Item(ModuleId),
}

/// One import of a `use` declaration.
#[derive(Clone, Debug)]
pub(super) struct Import {
    pub path: Vec<String>,
    /// The name it gets; `None` for a glob import.
    pub name: Option<String>,
    pub is_reexport: bool,
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
pub(super) struct Resolver<'a> {
    tree: &'a CrateTree,
    scopes: Vec<Scope>,
    /// The module that defines each macro. Macros are in scope by their position in the text, not by path.
    macros: HashMap<String, ModuleId>,
}

impl<'a> Resolver<'a> {
    pub fn new(tree: &'a CrateTree) -> Resolver<'a> {
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
    pub fn resolve(&self, module: ModuleId, path: &[String]) -> HashSet<Target> {
        self.follow(module, path, &mut HashSet::new())
    }

    /// The module that defines the macro `name`.
    pub fn defining_module_of_macro(&self, name: &str) -> Option<ModuleId> {
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
pub(super) fn imports(item: &ItemUse) -> Vec<Import> {
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
pub(super) fn text(ident: &Ident) -> String {
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
