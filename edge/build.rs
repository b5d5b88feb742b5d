//! Gives the linker the memory of the board that the features choose.

use std::{env, error::Error, fs, path::PathBuf};

/// The boards: the feature that chooses one, and its memory.
const BOARDS: [(&str, &str); 3] =
    [("stm32f405", "boards/stm32f405.x"), ("stm32h743", "boards/stm32h743.x"), ("an547", "boards/an547.x")];

/// The memory of the reference board.
const REFERENCE: &str = "../memory.x";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    let mut chosen =
        BOARDS.iter().filter(|(feature, _)| env::var_os(format!("CARGO_FEATURE_{}", feature.to_uppercase())).is_some());
    let memory = chosen.next().map_or(REFERENCE, |(_, memory)| memory);
    if let Some((second, _)) = chosen.next() {
        return Err(format!("firmware is linked for one board: choose {memory} or {second}, not both").into());
    }
    println!("cargo:rerun-if-changed={memory}");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy(memory, out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-examples=-Tlink.x");
    Ok(())
}
