//! `match --list`.

use std::{fs, path::Path};

use multiscopic_tests::program::{Invocation, make};

use super::Desk;

/// Seven small captures and their list, which is in another order.
fn rigs() -> Desk {
    let desk = Desk::new();
    make("scene --random --seed 3 --count 7 --size 48x36", &desk.path("rigs"));
    let list = "# Monday\nrigs/0003\nrigs/0000/\n\n./rigs/0001\nrigs/0002/rig.toml\nrigs/0006\nrigs/0005\nrigs/0004\n";
    fs::write(desk.path("list.txt"), list).expect("a list");
    desk
}

const MATCH: &str = "match --list @list.txt --method bm --num-disparities 16 -o d.pfm --png p.png";

#[test]
fn shares_are_all_rigs_once_and_merge_to_what_one_machine_makes() {
    let desk = rigs();
    desk.done(&format!("{MATCH} --results @whole"));
    assert_eq!(desk.recorded("whole").len(), 7);
    // Two machines share a folder, another has its own.
    desk.done(&format!("{MATCH} --results @shared --shard 3/3"));
    assert_eq!(desk.recorded("shared"), ["rigs/0001", "rigs/0005"]);
    desk.done(&format!("{MATCH} --results @shared --shard 1/3 --threads 1"));
    assert_eq!(desk.recorded("shared"), ["rigs/0001", "rigs/0002", "rigs/0003", "rigs/0004", "rigs/0005"]);
    let last = desk.done(&format!("{MATCH} --results @own --shard 2/3"));
    assert!(last.stderr.contains("2 of 7 items in shard 2/3: 2 done, 0 done before"), "{last:#?}");
    assert_eq!(desk.recorded("own"), ["rigs/0000", "rigs/0006"]);
    let (table, json) = desk.merged("@whole");
    assert_eq!(desk.merged("@own @shared"), (table.clone(), json.clone()));

    // In the order of the list.
    let rigs: Vec<serde_json::Value> = serde_json::from_str(&json).expect("a list");
    let names: Vec<&str> = rigs.iter().filter_map(|rig| rig["rig"].as_str()).collect();
    assert_eq!(names, ["3", "0", "1", "2", "6", "5", "4"].map(|number| format!("rigs/000{number}")));
    assert_eq!(table.lines().filter(|line| line.contains("48x36")).count(), 7, "{table}");
    assert!(!json.contains("milliseconds") && !json.contains("seconds"), "{json}");
    // The outputs are those of a match of the rig alone.
    desk.done("match @rigs/0001 --method bm --num-disparities 16 -o @alone.pfm --png @alone.png");
    for (number, (name, alone)) in [("d.pfm", "alone.pfm"), ("p.png", "alone.png")].into_iter().enumerate() {
        let alone = fs::read(desk.path(alone)).expect("an output");
        assert_eq!(fs::read(desk.path("shared/rigs/0001").join(name)).expect("an output"), alone);
        assert_eq!(rigs[2]["outputs"][number]["file"], name);
        assert_eq!(rigs[2]["outputs"][number]["bytes"], alone.len());
    }
}

/// Replaces a map by one that no match gives, with as many bytes.
fn mark(desk: &Desk, item: &str) {
    let path = desk.path("out").join(item).join("d.pfm");
    let length = fs::metadata(&path).expect("a map").len();
    fs::write(path, vec![b'*'; length as usize]).expect("a file");
}

fn is_marked(desk: &Desk, item: &str) -> bool {
    fs::read(desk.path("out").join(item).join("d.pfm")).is_ok_and(|map| map[0] == b'*')
}

#[test]
fn what_has_a_record_that_fits_is_not_done_again() {
    let desk = rigs();
    let command = format!("{MATCH} --results @out");
    let counts = |line: &str, expected: &str| {
        let run = desk.done(line);
        assert!(run.stderr.contains(expected), "{line}: {run:#?}");
    };
    counts(&command, "7 of 7 items in shard 1/1: 7 done, 0 done before");
    let (table, json) = desk.merged("@out");
    mark(&desk, "rigs/0000");
    counts(&format!("{command} --threads 1 --quiet"), "");
    counts(&command, "0 done, 7 done before");
    assert!(is_marked(&desk, "rigs/0000"), "it was not written again");
    desk.run("merge @out").assert_refused(&["rigs/0000/d.pfm", "other contents than those in its record"]);

    // A record that is torn, one that is gone, an output that is gone, and one of another length.
    let record = |item: &str| desk.path("out").join(item).join("record.json");
    let torn = fs::read(record("rigs/0000")).expect("a record");
    fs::write(record("rigs/0000"), &torn[..torn.len() / 2]).expect("a file");
    desk.run("merge @out").assert_refused(&["rigs/0000/record.json", "do it again"]);
    mark(&desk, "rigs/0001");
    fs::remove_file(record("rigs/0001")).expect("a record");
    fs::remove_file(desk.path("out/rigs/0002/p.png")).expect("a picture");
    fs::write(desk.path("out/rigs/0003/d.pfm"), "").expect("a map");
    counts(&command, "4 done, 3 done before");
    assert!(!is_marked(&desk, "rigs/0000") && !is_marked(&desk, "rigs/0001"));
    assert_eq!(desk.merged("@out"), (table, json.clone()));

    // Other images, and other parameters.
    fs::copy(desk.path("rigs/0004/left.png"), desk.path("rigs/0004/right.png")).expect("a picture");
    counts(&command, "1 done, 6 done before");
    assert_ne!(desk.merged("@out").1, json);
    counts(&format!("{command} --min-disparity 2"), "7 done, 0 done before");
    counts(&format!("{command} --min-disparity 2"), "0 done, 7 done before");
    // Rigs that are appended.
    let list = fs::read_to_string(desk.path("list.txt")).expect("a list");
    desk.done("scene --random --seed 9 --size 48x36 -o @others");
    fs::write(desk.path("list.txt"), list + "others/0000\n").expect("a list");
    counts(&format!("{command} --min-disparity 2"), "8 of 8 items in shard 1/1: 1 done, 7 done before");
    // Another truth, where a page shows it.
    let page = format!("{command} --report page.html");
    counts(&page, "8 done, 0 done before");
    fs::copy(desk.path("rigs/0005/truth.pfm"), desk.path("rigs/0004/truth.pfm")).expect("a map");
    counts(&page, "1 done, 7 done before");
}

#[test]
fn gaps_and_duplicates_are_refused_by_name() {
    let desk = rigs();
    desk.done(&format!("{MATCH} --results @a --shard 1/2"));
    desk.done(&format!("{MATCH} --results @b --shard 2/2"));
    desk.run("merge @a").assert_refused(&["3 of 7 items are missing: rigs/0000, rigs/0002, rigs/0005"]);
    desk.run("merge @a @a").assert_refused(&["is given twice"]);
    desk.run("merge @rigs").assert_refused(&["rigs", "a folder without run.json"]);
    desk.done(&format!("{MATCH} --results @whole"));
    desk.run("merge @b @whole").assert_refused(&["rigs/0000 is in both", "b and ", "whole"]);
    // Only some of another run.
    desk.done(&format!("{MATCH} --results @b --shard 1/2 --block-size 9"));
    desk.run("merge @a @b").assert_refused(&["b has results with --block-size as 9, not its default as in ", "one run"]);
    desk.run("merge @b").assert_refused(&["b/rigs/0000 has results with --block-size as its default, not 9"]);
    desk.done(&format!("{MATCH} --results @b --shard 2/2 --block-size 9"));
    desk.merged("@b");
}

#[test]
fn a_rig_that_fails_does_not_stop_the_others() {
    let desk = rigs();
    let right = desk.path("rigs/0000/right.png");
    let whole = fs::read(&right).expect("a picture");
    fs::write(&right, &whole[..whole.len() / 2]).expect("a file");
    fs::rename(desk.path("rigs/0006"), desk.path("away")).expect("a folder");
    let command = format!("{MATCH} --results @out");
    for done in [5, 0] {
        let run = desk.run(&command);
        assert_eq!(run.code, Some(1), "{run:#?}");
        let before = 5 - done;
        for words in [
            format!("{done} done, {before} done before, 2 failed: rigs/0000, rigs/0006"),
            "rigs/0000: ".into(),
            "right.png".into(),
            "rigs/0006: ".into(),
        ] {
            assert!(run.stderr.contains(&words), "{words}: {run:#?}");
        }
        assert_eq!(desk.recorded("out").len(), 5);
        assert!(!desk.path("out/rigs/0000").exists(), "nothing is left of what failed");
    }
    desk.run("merge @out").assert_refused(&["2 of 7 items are missing: rigs/0000, rigs/0006"]);
    fs::write(&right, whole).expect("a file");
    fs::rename(desk.path("away"), desk.path("rigs/0006")).expect("a folder");
    assert!(desk.done(&command).stderr.contains("2 done, 5 done before"));
    desk.merged("@out");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let desk = rigs();
    let refused = |line: &str, words: &[&str]| desk.run(line).assert_refused(words);
    refused("match --list @list.txt -o d.pfm", &["--results"]);
    refused("match --list @list.txt --results @out", &["nothing to write"]);
    refused("match --list @list.txt --results @out -o @d.pfm", &["d.pfm is not a name alone", "--results"]);
    refused("match --list @list.txt --results @out -o -", &["is not a name alone"]);
    refused("match --list @list.txt --results @out -o ../d.pfm", &["../d.pfm is not a name alone"]);
    refused("match --list @list.txt --results @out -o d.pfm --json", &["--json", "cannot be used"]);
    refused("match @rigs/0000 --results @out -o d.pfm", &["--results is for the rigs of a list"]);
    refused("match @rigs/0000 --list @list.txt --results @out -o d.pfm", &["cannot be used"]);
    refused("match @rigs/0000 --shard 1/2 -o d.pfm", &["--results"]);
    for shard in ["0/2", "3/2", "2"] {
        refused(&format!("match --list @list.txt --results @out -o d.pfm --shard {shard}"), &[shard, "I from 1 to N"]);
    }
    fs::write(desk.path("twice.txt"), "rigs/0000\n\nrigs/../rigs/0000\nrigs/0000\n").expect("a list");
    refused("match --list @twice.txt --results @out -o d.pfm", &["twice.txt", "line 3", "line 1, rigs/0000"]);
    refused("match --list @none.txt --results @out -o d.pfm", &["cannot read", "none.txt"]);
    assert!(!desk.path("out").exists(), "nothing is made in vain");
    // Results of another command.
    desk.done(&format!("{MATCH} --results @out --shard 7/7"));
    let run = fs::read_to_string(desk.path("out/run.json")).expect("a file");
    fs::write(desk.path("out/run.json"), run.replace("\"match\"", "\"evaluate\"")).expect("a file");
    refused(&format!("{MATCH} --results @out"), &["out has the results of `evaluate`", "another folder"]);
}

/// A device may have no end.
#[cfg(target_os = "linux")]
#[test]
fn devices_among_inputs_and_results_are_refused() {
    let desk = rigs();
    desk.done(&format!("{MATCH} --results @out"));
    for (name, line, code) in [
        ("rigs/0000/right.png", &*format!("{MATCH} --results @out"), 1),
        ("out/rigs/0005/d.pfm", "merge @out", 2),
        ("out/rigs/0003/record.json", "merge @out", 2),
        ("out/run.json", "merge @out", 2),
    ] {
        fs::remove_file(desk.path(name)).expect("a file");
        std::os::unix::fs::symlink("/dev/zero", desk.path(name)).expect("a link");
        let run = desk.run(line);
        assert_eq!(run.code, Some(code), "{name}: {run:#?}");
        assert!(run.stderr.contains(&format!("{name}: found a device, expected a file or a pipe")), "{name}: {run:#?}");
    }
}

/// No memory is taken for them.
#[test]
fn huge_and_damaged_results_are_refused() {
    let desk = rigs();
    desk.done(&format!("{MATCH} --results @out"));
    for (name, most) in [("out/rigs/0003/record.json", "4 MiB"), ("out/run.json", "32 MiB")] {
        let path = desk.path(name);
        let whole = fs::read(&path).expect("a file");
        fs::write(&path, &whole[..whole.len() / 2]).expect("a file");
        desk.run("merge @out").assert_refused(&[name, "found ", " (EOF while parsing "]);
        fs::File::create(&path).and_then(|file| file.set_len(1 << 40)).expect("a file without contents");
        desk.run("merge @out").assert_refused(&[name, &format!("found more than {most}, expected at most {most}")]);
        fs::write(&path, whole).expect("a file");
    }
    desk.merged("@out");
}

/// Long lists that differ in their last name are not compared name by name with each other: the processor time of `merge` grows
/// with their length, not with its square.
#[cfg(unix)]
#[test]
fn long_lists_are_compared_at_once() {
    const FEW: usize = 20_000;
    const TIMES: usize = 16;
    let desk = rigs();
    desk.done(&format!("{MATCH} --results @out --shard 7/7"));
    let text = fs::read_to_string(desk.path("out/run.json")).expect("a file");
    let mut run: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let [few, many] = [FEW, FEW * TIMES].map(|names| {
        for (folder, last) in [("a", "one"), ("b", "other")] {
            run["items"] = (1..names).map(|number| format!("rig{number:06}")).chain([last.into()]).collect();
            fs::create_dir_all(desk.path(folder)).expect("a folder");
            fs::write(desk.path(folder).join("run.json"), run.to_string()).expect("a file");
        }
        let (refused, seconds) = Invocation::with_processor_time([Path::new("merge"), &desk.path("a"), &desk.path("b")]);
        refused.assert_refused(&[&format!("b has other among its {names} items, not the {names} as in ")]);
        seconds
    });
    println!("{few} s of processor time for {FEW} names, {many} s for {TIMES} times as many");
    // Hundreds of times as much, if each name were compared with each.
    assert!(many < 4.0 * TIMES as f64 * few.max(0.02), "{few} s became {many} s");
}

#[cfg(unix)]
#[test]
fn names_do_not_command_the_terminal() {
    let desk = rigs();
    let name = "rigs/\u{1b}[31mred\u{9b}2J";
    fs::rename(desk.path("rigs/0003"), desk.path(name)).expect("a folder");
    fs::write(desk.path("list.txt"), format!("{name}\nrigs/none\x07\n")).expect("a list");
    let failed = desk.run(&format!("{MATCH} --results @out"));
    assert_eq!(failed.code, Some(1), "{failed:#?}");
    assert!(failed.stderr.contains("1 failed: rigs/none\\u0007"), "{failed:#?}");
    failed.assert_plain();
    fs::write(desk.path("list.txt"), name).expect("a list");
    desk.done(&format!("{MATCH} --results @out"));
    let (table, json) = desk.merged("@out");
    assert!(table.contains("rigs/\\u001b[31mred\\u009b2J "), "{table}");
    let rigs: Vec<serde_json::Value> = serde_json::from_str(&json).expect("a list");
    assert_eq!(rigs[0]["rig"], name);
}

/// Puts a pipe that nobody writes in the place of an image, so that a match of the rig never ends, or puts the image back.
#[cfg(target_os = "linux")]
fn block(desk: &Desk, item: usize, is_blocked: bool) {
    let [image, away] = ["center.png", "away.png"].map(|name| desk.path(&format!("rigs/000{item}/{name}")));
    if is_blocked {
        fs::rename(&image, &away).expect("an image");
        assert!(std::process::Command::new("mkfifo").arg(&image).status().expect("mkfifo").success());
    } else {
        fs::rename(&away, &image).expect("an image");
    }
}

#[cfg(target_os = "linux")]
#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_machine_that_is_killed_loses_nothing_that_was_done() {
    use std::{
        os::unix::process::ExitStatusExt,
        process::{Command, Stdio},
        thread,
        time::{Duration, Instant},
    };

    use multiscopic_tests::program;

    const COUNT: usize = 6;
    let desk = Desk::new();
    make("scene --random --seed 3 --count 7 --size 48x36", &desk.path("rigs"));
    let list: String = (0..COUNT).map(|number| format!("rigs/000{number}\n")).collect();
    fs::write(desk.path("list.txt"), list).expect("a list");
    let line = "match --list list.txt --method gc --num-disparities 16 --threads 1 -o d.pfm --ply c.ply --results out";
    let is_done = |item: usize| desk.path(&format!("out/rigs/000{item}/record.json")).exists();
    let mut done = 0;
    // One that can tidy up, and one that cannot. Each comes at any time before the match of the last item ends, which never does.
    for (signal, number, last) in [("TERM", 15, 2), ("KILL", 9, COUNT - 1)] {
        block(&desk, last, true);
        let mut command = Command::new(program::binary());
        command.args(line.split(' ')).current_dir(desk.folder.path()).stdin(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().expect("it starts");
        let start = Instant::now();
        while !is_done(done) {
            assert!(start.elapsed() < Duration::from_secs(180), "nothing is done");
            assert_eq!(child.try_wait().expect("it can be waited for"), None, "it ends before it is killed");
            thread::sleep(Duration::from_millis(1));
        }
        assert!(Command::new("kill").args([format!("-{signal}"), child.id().to_string()]).status().expect("kill").success());
        let status = child.wait().expect("it ends");
        match signal {
            "TERM" => assert_eq!(status.code(), Some(128 + number)),
            _ => assert_eq!(status.signal(), Some(number)),
        }
        let kept = (0..COUNT).filter(|&item| is_done(item)).count();
        assert!((done + 1..=last).contains(&kept), "{kept} of {COUNT} are done, {done} were before");
        done = kept;
        block(&desk, last, false);
    }
    let last = desk.done("match --list @list.txt --method gc --num-disparities 16 -o d.pfm --ply c.ply --results @out");
    assert!(last.stderr.contains(&format!("{} done, {done} done before", COUNT - done)), "{last:#?}");
    assert_eq!(desk.recorded("out").len(), COUNT);
    desk.done("match --list @list.txt --method gc --num-disparities 16 -o d.pfm --ply c.ply --results @whole --quiet");
    assert_eq!(desk.merged("@out"), desk.merged("@whole"));
}
