//! Says which instructions a Cortex-M has: `multiscopic_dsp` and `multiscopic_mve` if it has those extensions, and
//! `multiscopic_no_division` if it divides by a routine. On stable Rust, `target_feature` does not know the features of Arm.

use std::env;

/// The processors of ARMv8-M with the DSP extension, as `target-cpu` names them.
const WITH_DSP: [&str; 4] = ["cortex-m33", "cortex-m35p", "cortex-m52", "star-mc1"];
/// Those that have the vector extension besides.
const WITH_MVE: [&str; 2] = ["cortex-m55", "cortex-m85"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-check-cfg=cfg(multiscopic_dsp, multiscopic_mve, multiscopic_no_division)");
    let target = env::var("TARGET").unwrap_or_default();
    if !target.starts_with("thumb") {
        return;
    }
    let flags = env::var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    let is_one_of =
        |processors: &[&str], flag: &str| processors.iter().any(|processor| flag == format!("target-cpu={processor}"));
    // ARMv7E-M is ARMv7-M with the DSP extension.
    let (mut has_dsp, mut has_mve) = (target.starts_with("thumbv7em"), false);
    // `-Ctarget-cpu=NAME`, or `-C` and `target-cpu=NAME`.
    for flag in flags.split('\x1f').map(|flag| flag.strip_prefix("-C").unwrap_or(flag)) {
        has_mve |= is_one_of(&WITH_MVE, flag);
        has_dsp |= is_one_of(&WITH_DSP, flag) || has_mve;
        for feature in flag.strip_prefix("target-feature=").into_iter().flat_map(|features| features.split(',')) {
            match feature {
                "+dsp" => has_dsp = true,
                "-dsp" => (has_dsp, has_mve) = (false, false),
                "+mve" | "+mve.fp" => (has_dsp, has_mve) = (true, true),
                "-mve" | "-mve.fp" => has_mve = false,
                _ => {}
            }
        }
    }
    let has_no_division = target.starts_with("thumbv6m");
    for (name, is_set) in [("dsp", has_dsp), ("mve", has_mve), ("no_division", has_no_division)] {
        if is_set {
            println!("cargo:rustc-cfg=multiscopic_{name}");
        }
    }
}
