//! The program's outputs as its inputs: each pair works, or makes no sense and is refused.

use multiscopic_tests::program::{Invocation, make};

/// The outputs of commands on a rig with `D` for the folder of outputs, and the inputs that take them, of [`INPUTS`].
const OUTPUTS: [(&str, &str); 19] = [
    ("d.pfm", "prior truth view"),
    ("d.npy", "prior truth view"),
    ("d.npz", "prior truth view"),
    ("raw16.png", "center prior truth view"),
    ("color.png", "center"),
    ("confidence.png", "center"),
    // Nothing but images tells depths from disparities.
    ("depth.pfm", "view"),
    ("depth.npy", "view"),
    ("depth.npz", "view"),
    ("depth16.png", "center view"),
    ("depth.png", "center"),
    ("cloud.ply", ""),
    ("page.html", ""),
    ("metrics.json", ""),
    ("packets", "listen"),
    ("scene/0000", "rig evaluate view"),
    ("aligned", "rig view"),
    ("captured", "rig evaluate view"),
    ("mount.toml", "mount"),
];

/// Inputs, and command lines with `X` for the output, `RIG` for the rig and `D` for a folder.
const INPUTS: [(&str, &str); 9] = [
    ("center", "match --center X --right X --method bm --num-disparities 10 -o D/o.pfm"),
    ("prior", "match RIG --prior X -o D/o.pfm"),
    ("truth", "evaluate RIG --truth X --methods bm --num-disparities 10"),
    ("view", "view X --no-open --num-disparities 10 -o D/o.html"),
    ("listen", "listen X -o D/o.pfm"),
    ("lens", "match RIG --lens X --method bm --num-disparities 10 -o D/o.pfm"),
    ("rig", "match X --method bm --num-disparities 10 -o D/o.pfm"),
    ("evaluate", "evaluate X --methods bm --num-disparities 10"),
    ("mount", "capture --camera sim --stage sim --baseline 8 --views 2 --size 96x72 --settle 0 --mount X -o D/mounted"),
];

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn every_output_is_an_input_where_it_makes_sense() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let [rig, folder] = ["demo", "out"].map(|name| dir.path().join(name).to_str().expect("UTF-8").to_owned());
    make("demo --width 96 --height 72 --num-disparities 10", rig.as_ref());
    std::fs::create_dir(&folder).expect("a folder");
    let run = |command: &str, output: &str| {
        let words = command.split(' ').map(|word| match word {
            "RIG" => rig.clone(),
            "X" => output.to_owned(),
            word => word.replace("D/", &format!("{folder}/")),
        });
        Invocation::new(words)
    };
    for command in [
        "match RIG --method bm -o D/d.pfm --raw16 D/raw16.png --png D/color.png --confidence D/confidence.png --depth D/depth.pfm \
         --depth-png D/depth.png --ply D/cloud.ply --report D/page.html",
        "match RIG --method bm -o D/d.npy --depth D/depth.npy",
        "match RIG --method bm -o D/d.npz --depth D/depth.npz",
        "match RIG --method bm --depth D/depth16.png",
        "evaluate RIG --methods bm --json D/metrics.json",
        "simulate --profile qqvga --packets D/packets",
        "scene --random --seed 1 --count 1 --size 96x72 -o D/scene",
        "align RIG -o D/aligned",
        "capture --camera sim --stage sim --baseline 8 --views 2 --size 96x72 --settle 0 -o D/captured",
        "calibrate mount --camera sim --stage sim --settle 0 --focal-px 1180 -o D/mount.toml",
    ] {
        let run = run(command, "");
        assert_eq!(run.code, Some(0), "{command}: {run:#?}");
    }
    let mut wrong = Vec::new();
    for (output, inputs) in OUTPUTS {
        for (input, command) in INPUTS {
            let path = format!("{folder}/{output}");
            let run = run(command, &path);
            let is_right = match inputs.split(' ').any(|name| name == input) {
                true => run.code == Some(0),
                false => run.code == Some(2) && run.stderr.lines().count() == 1 && run.stderr.contains(output),
            };
            if !is_right {
                wrong.push(format!("{output} as {input}: {run:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
