//! Names that several modules or public types of the workspace share.

use std::collections::{BTreeMap, BTreeSet};

use syn::{Item, Visibility};

use super::{crate_tree::CrateTree, violation::Violation, workspace::Use};

/// A name that several modules or types may share.
struct Shared {
    name: &'static str,
    /// The prefixes of their files' paths.
    places: &'static [&'static str],
    #[expect(dead_code, reason = "it is for the reader")]
    reason: &'static str,
}

const SHARED_MODULES: [Shared; 8] = [
    Shared {
        name: "network",
        places: &["core/src/", "host/src/stereo/"],
        reason: "the networks of MC-CNN give costs, the method's own disparities, which the core gives as well",
    },
    Shared { name: "parameters", places: &["host/src/stereo/"], reason: "each method has its own" },
    Shared { name: "error", places: &[""], reason: "each crate and room has its own errors" },
    Shared {
        name: "capture",
        places: &["core/src/capture/", "host/src/capture/", "host/cli/src/command/"],
        reason: "the sequence, the host's hardware for it, and the command",
    },
    Shared {
        name: "weights",
        places: &["host/src/stereo/cost/mccnn/", "host/cli/src/command/"],
        reason: "the command is named after what it installs",
    },
    Shared {
        name: "camera",
        places: &["core/src/capture/", "host/src/capture/"],
        reason: "the trait, and the host's implementation",
    },
    Shared {
        name: "stage",
        places: &["core/src/capture/", "host/src/capture/"],
        reason: "the trait, and the host's implementations",
    },
    Shared { name: "depth", places: &["core/src/", "host/src/image"], reason: "the depth of a pixel, and of a whole map" },
];

const SHARED_TYPES: [Shared; 5] = [
    Shared { name: "Error", places: &[""], reason: "the error of its room, named with it" },
    Shared { name: "Result", places: &[""], reason: "the result of its room, named with it" },
    Shared {
        name: "Camera",
        places: &["core/src/capture/", "host/src/capture/"],
        reason: "the trait, and the host's implementation",
    },
    Shared { name: "V4l2Camera", places: &["host/src/capture/camera/"], reason: "real cameras, and builds without them" },
    Shared { name: "CameraError", places: &["host/src/capture/camera/"], reason: "real cameras, and builds without them" },
];

/// Folders whose names follow those of other parts, and the reason.
const FOLLOWING: [(&str, &str); 6] = [
    ("core/src/kernel/arm/", "the kernels of each instruction set are divided alike"),
    ("host/cli/src/command/", "commands and options are named for what they run and set"),
    ("python/src/", "what Python sees is named for what it runs"),
    ("tests/src/reference/", "second implementations are named for what they are compared with"),
    ("tests/src/simulated/", "simulated hardware is named for what drives it"),
    ("tests/src/test_images/real_data.rs", "it reads the data sets a second time"),
];

/// Finds names that are shared without a stated reason. Tests are exempt, since they are named for what they
/// test.
pub(super) fn check(trees: &[(CrateTree, Use)]) -> Vec<Violation> {
    let mut modules: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut types = modules.clone();
    for (tree, _) in trees.iter().filter(|(_, usage)| *usage != Use::Test) {
        for (id, module) in tree.modules.iter().enumerate() {
            let place = tree.place(module.file);
            if FOLLOWING.iter().any(|(start, _)| place.starts_with(start)) {
                continue;
            }
            if id != 0 {
                modules.entry(module.name.clone()).or_default().insert(place.clone());
            }
            for name in module.items.iter().filter_map(public_type) {
                types.entry(name).or_default().insert(place.clone());
            }
        }
    }
    shared("module", modules, &SHARED_MODULES).chain(shared("public type", types, &SHARED_TYPES)).collect()
}

fn shared<'a>(
    kind: &'a str,
    names: BTreeMap<String, BTreeSet<String>>,
    allowed: &'a [Shared],
) -> impl Iterator<Item = Violation> + 'a {
    let is_allowed = |name: &str, places: &BTreeSet<String>| {
        let shared = allowed.iter().find(|shared| shared.name == name);
        shared.is_some_and(|shared| places.iter().all(|place| shared.places.iter().any(|start| place.starts_with(start))))
    };
    names.into_iter().filter(move |(name, places)| places.len() > 1 && !is_allowed(name, places)).map(move |(name, places)| {
        let mut places = places.into_iter();
        let place = places.next().unwrap_or_default();
        let others = places.collect::<Vec<_>>().join(", ");
        Violation { place, message: format!("the {kind} `{name}` shares its name with that in {others}") }
    })
}

fn public_type(item: &Item) -> Option<String> {
    let (visibility, name) = match item {
        Item::Enum(item) => (&item.vis, &item.ident),
        Item::Struct(item) => (&item.vis, &item.ident),
        Item::Trait(item) => (&item.vis, &item.ident),
        Item::Type(item) => (&item.vis, &item.ident),
        Item::Union(item) => (&item.vis, &item.ident),
        _ => return None,
    };
    matches!(visibility, Visibility::Public(_)).then(|| name.to_string())
}
