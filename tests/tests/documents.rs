//! Checks that everything that the guides name exists: files, headings, and packages of cargo's commands. `cargo xtask`'s own
//! tests check its commands, and those of the program its command lines.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

/// Folders of the repository: a name in code style that begins with one is a path.
const FOLDERS: [&str; 11] =
    [".cargo/", ".ci/", ".github/", "core/", "docs/", "edge/", "fuzz/", "host/", "python/", "tests/", "train/"];
/// The guide that names modules by their paths in a crate, without what is common to all.
const OF_MODULES: &str = "docs/architecture.md";
/// The sources of crates, below which those are.
const SOURCES: [&str; 6] = ["core/src", "edge/src", "host/src", "host/engine/src", "host/cli/src", "host/cli/src/command"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests are a folder of the workspace")
}

/// A guide.
struct Guide {
    /// The path from the root.
    name: String,
    text: String,
}

/// The guides: those at the root, in `docs`, and the readme of each crate. What `CHANGELOG.md` names may be gone.
fn guides() -> Vec<Guide> {
    let folders = ["", "docs", "core", "edge", "edge/drivers", "edge/pico2", "host", "host/cli", "python", "train"];
    let mut guides = Vec::new();
    for folder in folders {
        let entries = fs::read_dir(root().join(folder)).expect("a folder with guides");
        let paths = entries.map(|entry| entry.expect("an entry").path());
        let paths = paths.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
        for path in paths.filter(|path| !path.ends_with("CHANGELOG.md")) {
            let name = path.strip_prefix(root()).expect("a path in the repository").to_string_lossy().into_owned();
            guides.push(Guide { name, text: fs::read_to_string(&path).expect("a guide") });
        }
    }
    assert!(guides.len() > 15, "{} guides", guides.len());
    guides
}

impl Guide {
    /// The folder that its links are relative to.
    fn folder(&self) -> PathBuf {
        root().join(&self.name).parent().expect("a folder").into()
    }

    /// The text outside of blocks of code.
    fn prose(&self) -> String {
        self.text.split("```").step_by(2).collect()
    }

    /// Returns the parts of the text in code style.
    fn code(&self) -> Vec<String> {
        self.prose().split('`').skip(1).step_by(2).map(str::to_owned).collect()
    }

    /// The targets of its links within the repository: a path, which is empty for the guide itself, and a heading.
    fn links(&self) -> Vec<(String, Option<String>)> {
        let prose = self.prose();
        let targets = prose.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target);
        let is_here = |target: &&str| !target.contains("://") && !target.starts_with("mailto:") && !target.contains(' ');
        let split = |target: &str| match target.split_once('#') {
            Some((path, heading)) => (path.to_owned(), Some(heading.to_owned())),
            None => (target.to_owned(), None),
        };
        targets.filter(is_here).map(split).collect()
    }
}

/// The anchors of a text's headings, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = text.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    let letter = |letter: char| match letter {
        ' ' => Some('-'),
        _ if letter.is_alphanumeric() || ['-', '_'].contains(&letter) => Some(letter),
        _ => None,
    };
    headings.map(|heading| heading.to_lowercase().chars().filter_map(letter).collect()).collect()
}

/// Returns true if a name in code style is a path of this repository.
fn is_path(code: &str) -> bool {
    let is_plain = code.chars().all(|letter| letter.is_ascii_alphanumeric() || "_-./".contains(letter));
    is_plain && FOLDERS.iter().any(|folder| code.starts_with(folder))
}

/// Returns true if a name in code style is the path of a module, such as `kernel/blocks`.
fn is_module(code: &str) -> bool {
    let is_plain = code.chars().all(|letter| letter.is_ascii_lowercase() || letter == '_' || letter == '/');
    is_plain && code.contains('/') && !code.starts_with('/') && !is_path(code)
}

#[test]
fn paths_exist() {
    let mut missing = Vec::new();
    for guide in guides() {
        for code in guide.code().into_iter().filter(|code| is_path(code)) {
            // A crate's readme also names its own folders.
            if !root().join(&code).exists() && !guide.folder().join(&code).exists() {
                missing.push(format!("{}: {code}", guide.name));
            }
        }
    }
    assert!(missing.is_empty(), "{} paths are gone:\n{}", missing.len(), missing.join("\n"));
}

#[test]
fn modules_exist() {
    let guide = Guide { name: OF_MODULES.into(), text: fs::read_to_string(root().join(OF_MODULES)).expect("the guide") };
    let is_there = |code: &str| {
        let code = code.trim_end_matches('/');
        SOURCES.iter().any(|source| {
            let path = root().join(source).join(code);
            path.is_dir() || path.with_extension("rs").is_file()
        })
    };
    let modules: Vec<String> = guide.code().into_iter().filter(|code| is_module(code)).collect();
    let missing: Vec<&String> = modules.iter().filter(|code| !is_there(code)).collect();
    assert!(missing.is_empty(), "{OF_MODULES} names modules that are gone: {missing:?}");
}

#[test]
fn links_lead_somewhere() {
    let mut dead = Vec::new();
    for guide in guides() {
        for (path, heading) in guide.links() {
            let target = if path.is_empty() { root().join(&guide.name) } else { guide.folder().join(&path) };
            let is_there = match &heading {
                None => target.exists(),
                Some(heading) => fs::read_to_string(&target).is_ok_and(|text| anchors(&text).contains(heading)),
            };
            if !is_there {
                dead.push(format!("{}: {path}{}", guide.name, heading.map(|heading| format!("#{heading}")).unwrap_or_default()));
            }
        }
    }
    assert!(dead.is_empty(), "{} links are dead:\n{}", dead.len(), dead.join("\n"));
}

/// The crates of the repository by name, with the names of what `--bin`, `--example`, `--test` and `--bench` can select in them.
fn packages() -> Vec<(String, String)> {
    let folders = [
        "core",
        "edge",
        "edge/drivers",
        "edge/firmware",
        "edge/pico2",
        "fuzz",
        "host",
        "host/engine",
        "host/cli",
        "python",
        "tests",
    ];
    let manifests = folders.iter().map(|folder| root().join(folder).join("Cargo.toml")).filter(|path| path.is_file());
    let read = |path: PathBuf| {
        let manifest: toml::Table = fs::read_to_string(&path).expect("a manifest").parse().expect("a manifest in TOML");
        let text = |table: &str| manifest[table]["name"].as_str().expect("a name").to_owned();
        let programs = manifest.get("bin").and_then(toml::Value::as_array).into_iter().flatten();
        (text("package"), programs.filter_map(|program| program["name"].as_str()).collect::<Vec<_>>().join(" "))
    };
    manifests.map(read).collect()
}

#[test]
fn packages_of_commands_exist() {
    let packages = packages();
    let mut wrong = Vec::new();
    let mut commands = 0;
    for guide in guides() {
        let blocks = guide.text.split("```").skip(1).step_by(2).flat_map(str::lines).map(str::to_owned);
        let indented = guide.text.lines().filter_map(|line| line.strip_prefix("    ")).map(str::to_owned);
        for command in guide.code().into_iter().chain(blocks).chain(indented) {
            let Some((_, arguments)) = command.split_once("cargo ") else { continue };
            if arguments.starts_with("xtask") {
                continue;
            }
            commands += 1;
            let words: Vec<&str> = arguments.split([' ', '=']).collect();
            let value =
                |options: &[&str]| words.iter().position(|word| options.contains(word)).and_then(|place| words.get(place + 1));
            let package = value(&["-p", "--package"]).map(|name| packages.iter().find(|(package, _)| package == name));
            let is_wrong = match (package, value(&["--bin"]), value(&["--path"])) {
                (Some(None), ..) => true,
                (Some(Some((_, programs))), Some(program), _) => !programs.split(' ').any(|name| name == *program),
                (_, _, Some(path)) => !root().join(path).join("Cargo.toml").is_file(),
                _ => false,
            };
            if is_wrong {
                wrong.push(format!("{}: cargo {arguments}", guide.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{} commands name what is not there:\n{}", wrong.len(), wrong.join("\n"));
    assert!(commands > 5, "{commands} commands");
}

#[test]
fn names_are_told_from_paths() {
    assert!(is_path("core/src/fusion.rs") && is_path("tests/") && !is_path("target/fuzz") && !is_path("docs/*.md"));
    assert!(is_module("kernel/blocks") && is_module("live/") && !is_module("n / 2") && !is_module("/disparity"));
    assert_eq!(anchors("# What `x` is: two words\n"), ["what-x-is-two-words".to_owned()].into());
}
