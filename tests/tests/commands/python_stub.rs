//! The types of Python's keyword arguments, which `python/multiscopic.pyi` repeats for type checkers.

use std::{env, fs, path::Path};

use multiscopic_options::keywords::{self, Keyword};

/// With `MULTISCOPIC_BLESS` set, the stub is written anew.
#[test]
fn the_stub_of_the_python_package_lists_the_options() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../python/multiscopic.pyi");
    let stub = fs::read_to_string(&path).unwrap();
    let (before, rest) =
        stub.split_once("    \"\"\"The keyword arguments of match(), whose help describes them.\"\"\"\n\n").unwrap();
    let (listed, after) = rest.split_once("\n@final").unwrap();
    let expected = keywords::stub(&Keyword::all());
    if env::var_os("MULTISCOPIC_BLESS").is_some() {
        let head = &stub[..stub.len() - rest.len()];
        fs::write(&path, format!("{head}{expected}\n@final{after}")).unwrap();
        return;
    }
    assert!(before.ends_with("class _Options(TypedDict, total=False):\n"));
    assert_eq!(listed, expected, "write it anew with MULTISCOPIC_BLESS=1 cargo test -p multiscopic-tests --test commands stub");
}
