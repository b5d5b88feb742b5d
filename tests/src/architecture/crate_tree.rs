//! A crate's modules and files.

use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

use syn::{Attribute, Expr, ExprLit, Item, Lit, Meta, ext::IdentExt};

/// A file's index in [`CrateTree::files`].
pub(super) type FileId = usize;
/// A module's index in [`CrateTree::modules`].
pub(super) type ModuleId = usize;

/// A parsed crate.
pub(super) struct CrateTree {
    /// Paths relative to the workspace. The first file is the crate's root.
    pub files: Vec<PathBuf>,
    /// The first module is the crate's root.
    pub modules: Vec<Module>,
}

/// A module. Modules for unit tests are left out.
pub(super) struct Module {
    pub name: String,
    pub file: FileId,
    pub parent: Option<ModuleId>,
    pub children: Vec<ModuleId>,
    /// Its items, without child modules and items for unit tests.
    pub items: Vec<Item>,
    /// Its attributes, such as its documentation.
    pub attributes: Vec<Attribute>,
}

impl CrateTree {
    /// Reads the crate whose root file is `path`, in the workspace at `root`.
    pub fn read(root: &Path, path: &Path) -> Result<CrateTree, Box<dyn Error>> {
        let mut tree = CrateTree { files: Vec::new(), modules: Vec::new() };
        let folder = path.parent().ok_or("a source file without a folder")?;
        tree.read_file(root, path, folder, "crate", None)?;
        Ok(tree)
    }

    /// Reads the module in the file `path`, whose child modules' files are in `folder`.
    fn read_file(
        &mut self,
        root: &Path,
        path: &Path,
        folder: &Path,
        name: &str,
        parent: Option<ModuleId>,
    ) -> Result<ModuleId, Box<dyn Error>> {
        let text = fs::read_to_string(path).map_err(|error| format!("cannot read {}: {error}", path.display()))?;
        let file = syn::parse_file(&text).map_err(|error| format!("cannot parse {}: {error}", path.display()))?;
        self.files.push(path.strip_prefix(root).unwrap_or(path).into());
        let module = Module {
            name: name.into(),
            file: self.files.len() - 1,
            parent,
            children: Vec::new(),
            items: Vec::new(),
            attributes: file.attrs,
        };
        self.add(root, folder, module, file.items)
    }

    /// Adds a module and its child modules.
    fn add(&mut self, root: &Path, folder: &Path, module: Module, items: Vec<Item>) -> Result<ModuleId, Box<dyn Error>> {
        let (id, file) = (self.modules.len(), module.file);
        self.modules.push(module);
        for item in items.into_iter().filter(|item| !is_for_tests(attributes(item))) {
            let Item::Mod(mut inner) = item else {
                self.modules[id].items.push(item);
                continue;
            };
            let name = inner.ident.unraw().to_string();
            let child = match inner.content.take() {
                Some((_, items)) => {
                    let attributes = inner.attrs.clone();
                    let child = Module {
                        name: name.clone(),
                        file,
                        parent: Some(id),
                        children: Vec::new(),
                        items: Vec::new(),
                        attributes,
                    };
                    self.add(root, &folder.join(&name), child, items)?
                }
                None => {
                    let (path, folder) = match value(&inner.attrs, "path") {
                        Some(path) => {
                            // The path is relative to the folder of the declaring file.
                            let here = root.join(&self.files[file]);
                            let path = here.parent().unwrap_or(root).join(path);
                            let folder = path.parent().unwrap_or(root).into();
                            (path, folder)
                        }
                        None => module_file(folder, &name),
                    };
                    self.read_file(root, &path, &folder, &name, Some(id))?
                }
            };
            self.modules[id].children.push(child);
        }
        Ok(id)
    }

    /// The path of a file, as violations report it.
    pub fn place(&self, file: FileId) -> String {
        self.files[file].to_string_lossy().replace('\\', "/")
    }

    /// The top-level module that a module is in; `None` for the crate's root.
    pub fn top_level(&self, mut module: ModuleId) -> Option<ModuleId> {
        while let Some(parent) = self.modules[module].parent {
            if parent == 0 {
                return Some(module);
            }
            module = parent;
        }
        None
    }

    /// The child of `module` called `name`.
    pub fn child(&self, module: ModuleId, name: &str) -> Option<ModuleId> {
        self.modules[module].children.iter().copied().find(|&child| self.modules[child].name == name)
    }

    /// Returns true if `module` is `ancestor` or a descendant of it.
    pub fn is_within(&self, mut module: ModuleId, ancestor: ModuleId) -> bool {
        while module != ancestor {
            match self.modules[module].parent {
                Some(parent) => module = parent,
                None => return false,
            }
        }
        true
    }
}

/// The file of the module `name` declared in `folder`, and the folder of its children's files.
fn module_file(folder: &Path, name: &str) -> (PathBuf, PathBuf) {
    let (file, inner) = (folder.join(format!("{name}.rs")), folder.join(name));
    if file.is_file() { (file, inner) } else { (inner.join("mod.rs"), inner) }
}

/// Returns true if an item is compiled only for unit tests.
fn is_for_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| match &attribute.meta {
        Meta::List(list) if list.path.is_ident("cfg") => list.tokens.to_string() == "test",
        _ => false,
    })
}

/// The text of the attribute `name = "text"`.
pub(super) fn value(attributes: &[Attribute], name: &str) -> Option<String> {
    attributes.iter().filter(|attribute| attribute.path().is_ident(name)).find_map(text)
}

/// The text in an attribute, such as a line of documentation.
pub(super) fn text(attribute: &Attribute) -> Option<String> {
    let Meta::NameValue(pair) = &attribute.meta else { return None };
    match &pair.value {
        Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) => Some(text.value()),
        _ => None,
    }
}

pub(super) fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::ExternCrate(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::ForeignMod(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::TraitAlias(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Union(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}
