//! The parts of the workspace: dependencies, the reasons for them, and our own unsafe code. `cargo deny` checks their licences.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, anyhow, ensure};
use clap::Args;
use serde_json::{Value, json};
use syn::visit::{self, Visit};

use crate::{
    system::{self, command, read, run},
    tools,
};

/// The document with the reason for each direct dependency and the count of unsafe code.
const DOCUMENT: &str = "docs/dependencies.md";

/// Checks duplicate versions and the reasons for dependencies, and counts unsafe code.
#[derive(Args)]
pub struct SupplyChain {
    /// Write a bill of materials of what the program and the firmware are built from, as CycloneDX
    #[arg(long, value_name = "OUT.json")]
    sbom: Option<PathBuf>,

    /// Build `cargo deny`, and check licences, sources and bans by it
    #[arg(long)]
    deny: bool,

    /// Build `cargo deny`, and look the dependencies up in RustSec's database of advisories, which is fetched
    #[arg(long)]
    advisories: bool,
}

impl SupplyChain {
    /// The check alone.
    pub const CHECK: SupplyChain = SupplyChain { sbom: None, deny: false, advisories: false };
    /// The check, and `cargo deny` without advisories: what was known yesterday would fail today.
    pub const DENY: SupplyChain = SupplyChain { deny: true, ..SupplyChain::CHECK };

    /// Runs the checks.
    pub fn run(&self) -> Result<()> {
        let workspace = Metadata::read()?;
        let document = fs::read_to_string(system::root().join(DOCUMENT)).with_context(|| format!("cannot read {DOCUMENT}"))?;
        let mut complaints = differences("dependency", &workspace.direct(), &first_cells(&document, "## Direct dependencies"));
        complaints.extend(differences(
            "duplicate version",
            &duplicates_of_program()?,
            &first_cells(&document, "## Duplicate versions"),
        ));
        let counted: BTreeSet<String> = unsafe_code(&workspace)?.iter().map(ToString::to_string).collect();
        let written = table_rows(&document, "## Unsafe code").map(str::to_owned).collect();
        complaints.extend(differences("row of unsafe code", &counted, &written));
        ensure!(complaints.is_empty(), "{DOCUMENT} is not up to date:\n{}", complaints.join("\n"));
        if self.deny {
            run(tools::DENY.command()?.args(["--locked", "check", "bans", "licenses", "sources"]))?;
        }
        if self.advisories {
            run(tools::DENY.command()?.args(["--locked", "check", "advisories"]))?;
        }
        if let Some(path) = &self.sbom {
            let text = serde_json::to_string_pretty(&workspace.bill_of_materials())?;
            fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
        }
        let (all, direct) = (workspace.foreign().count(), workspace.direct().len());
        println!("supply chain: {all} dependencies, {direct} of them direct, each with a reason");
        Ok(())
    }
}

/// Cargo's metadata of all packages.
struct Metadata(Value);

impl Metadata {
    fn read() -> Result<Metadata> {
        let output = command("cargo", ["metadata", "--locked", "--format-version", "1"]).output()?;
        let error = || anyhow!("cargo metadata failed:\n{}", String::from_utf8_lossy(&output.stderr));
        ensure!(output.status.success(), error());
        Ok(Metadata(serde_json::from_slice(&output.stdout)?))
    }

    fn packages(&self) -> impl Iterator<Item = &Value> {
        self.0["packages"].as_array().into_iter().flatten()
    }

    /// Packages of the workspace have no source.
    fn own(&self) -> impl Iterator<Item = &Value> {
        self.packages().filter(|package| package["source"].is_null())
    }

    fn foreign(&self) -> impl Iterator<Item = &Value> {
        self.packages().filter(|package| !package["source"].is_null())
    }

    /// The names of the packages of others on which ours depend themselves.
    fn direct(&self) -> BTreeSet<String> {
        let dependencies = self.own().flat_map(|package| package["dependencies"].as_array().into_iter().flatten());
        dependencies.filter(|dependency| dependency["path"].is_null()).map(|dependency| text(&dependency["name"])).collect()
    }

    /// The packages and what depends on what, in the words of CycloneDX 1.5.
    fn bill_of_materials(&self) -> Value {
        let reference = |package: &Value| format!("pkg:cargo/{}@{}", text(&package["name"]), text(&package["version"]));
        let references: BTreeMap<&str, String> =
            self.packages().filter_map(|package| Some((package["id"].as_str()?, reference(package)))).collect();
        let components: Vec<Value> = self
            .packages()
            .map(|package| {
                json!({
                    "type": if package["source"].is_null() { "application" } else { "library" },
                    "bom-ref": reference(package),
                    "name": package["name"],
                    "version": package["version"],
                    "purl": reference(package),
                    "licenses": [{ "expression": text(&package["license"]).replace('/', " OR ") }],
                })
            })
            .collect();
        let nodes = self.0["resolve"]["nodes"].as_array().into_iter().flatten();
        let of_id = |id: &Value| id.as_str().and_then(|id| references.get(id));
        let dependencies: Vec<Value> = nodes
            .map(|node| {
                let needed: Vec<_> = node["dependencies"].as_array().into_iter().flatten().filter_map(of_id).collect();
                json!({ "ref": of_id(&node["id"]), "dependsOn": needed })
            })
            .collect();
        json!({
            "bomFormat": "CycloneDX",
            "specVersion": "1.5",
            "version": 1,
            "components": components,
            "dependencies": dependencies,
        })
    }
}

/// The packages that the program for Linux is built from in more than one version.
fn duplicates_of_program() -> Result<BTreeSet<String>> {
    let words = ["tree", "--locked", "--package=multiscopic-cli", "--edges=normal", "--target=x86_64-unknown-linux-gnu"];
    // Lines such as `syn v2.0.1 (proc-macro)`.
    let tree = read(command("cargo", words).args(["--prefix=none", "--format={p}"]))?;
    let versions: BTreeSet<(&str, &str)> = tree
        .lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(name, rest)| (name, rest.split(' ').next().unwrap_or(rest)))
        .collect();
    let mut counts = BTreeMap::<&str, usize>::new();
    versions.iter().for_each(|(name, _)| *counts.entry(name).or_default() += 1);
    Ok(counts.into_iter().filter(|(_, count)| *count > 1).map(|(name, _)| name.to_owned()).collect())
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().into()
}

/// The rows of the table below a heading, without its head.
fn table_rows<'a>(document: &'a str, heading: &str) -> impl Iterator<Item = &'a str> {
    let section = document.split_once(heading).map_or("", |(_, rest)| rest).split("\n## ").next().unwrap_or_default();
    section.lines().filter(|line| line.starts_with('|')).skip(2)
}

/// Returns the text in code style in the first cells of the table below a heading.
fn first_cells(document: &str, heading: &str) -> BTreeSet<String> {
    table_rows(document, heading).filter_map(|row| Some(row.split('`').nth(1)?.to_owned())).collect()
}

/// A complaint about each element that only one of two sets has.
fn differences(what: &str, found: &BTreeSet<String>, written: &BTreeSet<String>) -> Vec<String> {
    let missing = found.difference(written).map(|name| format!("the {what} is not in {DOCUMENT}: {name}"));
    let outdated = written.difference(found).map(|name| format!("the {what} is in {DOCUMENT}, but not in the workspace: {name}"));
    missing.chain(outdated).collect()
}

/// The unsafe code of a package.
#[derive(Default)]
struct UnsafeCode {
    package: String,
    /// The files that have any.
    files: usize,
    blocks: usize,
    functions: usize,
    implementations: usize,
}

impl std::fmt::Display for UnsafeCode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let UnsafeCode { package, files, blocks, functions, implementations } = self;
        write!(f, "| `{package}` | {files} | {blocks} | {functions} | {implementations} |")
    }
}

impl<'ast> Visit<'ast> for UnsafeCode {
    fn visit_expr_unsafe(&mut self, block: &'ast syn::ExprUnsafe) {
        self.blocks += 1;
        visit::visit_expr_unsafe(self, block);
    }

    fn visit_signature(&mut self, signature: &'ast syn::Signature) {
        self.functions += usize::from(matches!(signature.safety, syn::Safety::Unsafe(_)));
        visit::visit_signature(self, signature);
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        self.implementations += usize::from(item.unsafety.is_some());
        visit::visit_item_impl(self, item);
    }
}

/// Returns the unsafe code in `src` of each of our packages that has any. Code that macros make is not seen.
fn unsafe_code(workspace: &Metadata) -> Result<Vec<UnsafeCode>> {
    let mut all = Vec::new();
    for package in workspace.own() {
        let manifest = text(&package["manifest_path"]);
        let sources = Path::new(&manifest).with_file_name("src");
        let mut counted = UnsafeCode { package: text(&package["name"]), ..UnsafeCode::default() };
        for path in rust_files(&sources)? {
            let source = fs::read_to_string(&path)?;
            let file = syn::parse_file(&source).with_context(|| format!("cannot parse {}", path.display()))?;
            let before = counted.blocks + counted.functions + counted.implementations;
            counted.visit_file(&file);
            counted.files += usize::from(counted.blocks + counted.functions + counted.implementations > before);
        }
        if counted.files > 0 {
            all.push(counted);
        }
    }
    Ok(all)
}

fn rust_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
        let path = entry?.path();
        if path.is_dir() {
            files.extend(rust_files(&path)?);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOCUMENT: &str = "# D\n\n## Direct dependencies\n\n| crate | why |\n| --- | --- |\n| `a` | x |\n| `b-c` | y |\n\n## Other\n\n| `d` | z |\n";

    #[test]
    fn a_table_ends_with_its_section() {
        let names = ["a", "b-c"].map(str::to_owned).into();
        assert_eq!(first_cells(DOCUMENT, "## Direct dependencies"), names);
        assert_eq!(differences("name", &["a".to_owned(), "e".to_owned()].into(), &names).len(), 2);
    }

    #[test]
    fn unsafe_code_of_all_kinds_is_counted() {
        let source = "unsafe fn f() {} unsafe impl T for U {} fn g() { unsafe { f() }; if x { unsafe { f() } } }";
        let mut counted = UnsafeCode::default();
        counted.visit_file(&syn::parse_file(source).expect("a source"));
        assert_eq!([counted.blocks, counted.functions, counted.implementations], [2, 1, 1]);
    }
}
