//! Gives the linker the memory of the board that the features choose.

use std::{env, error::Error, fs, path::PathBuf};

/// The boards beside the reference board: their features, and the linker scripts that set their memory.
const BOARDS: [(&str, &str); 6] = [
    ("rp2040", "boards/rp2040.x"),
    ("stm32f405", "boards/stm32f405.x"),
    ("stm32h743", "boards/stm32h743.x"),
    ("rp2350", "boards/rp2350.x"),
    ("rp2350-riscv", "boards/rp2350-riscv.x"),
    ("an547", "boards/an547.x"),
];

/// The memory script. The script of another board precedes it.
const MEMORY: &str = "../../memory.x";

/// The regions of memory for the runtime of RISC-V.
const REGIONS: &str = "boards/riscv-rt.x";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    let is_chosen = |feature: &str| env::var_os(format!("CARGO_FEATURE_{}", feature.to_uppercase().replace('-', "_"))).is_some();
    let chosen: Vec<_> = BOARDS.iter().filter(|(feature, _)| is_chosen(feature)).collect();
    let mut scripts = Vec::new();
    match chosen[..] {
        [] => {}
        [(_, script)] => {
            println!("cargo:rerun-if-changed={script}");
            scripts.push(fs::canonicalize(script)?.display().to_string());
        }
        [(first, _), (second, _), ..] => {
            return Err(format!("firmware is linked for one board: choose the feature {first} or {second}, not both").into());
        }
    }
    println!("cargo:rerun-if-changed={MEMORY}");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy(MEMORY, out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    // `link.x` of cortex-m-rt includes the memory script, that of riscv-rt does not.
    if env::var("CARGO_CFG_TARGET_ARCH")? == "riscv32" {
        println!("cargo:rerun-if-changed={REGIONS}");
        scripts.extend(["memory.x".to_owned(), fs::canonicalize(REGIONS)?.display().to_string()]);
    }
    scripts.extend(["link.x".to_owned(), "defmt.x".to_owned()]);
    for script in scripts {
        println!("cargo:rustc-link-arg-bins=-T{script}");
        println!("cargo:rustc-link-arg-examples=-T{script}");
    }
    Ok(())
}
