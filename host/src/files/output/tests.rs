use super::*;

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_complete_file_replaces_the_old_one() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    for text in ["first", "2nd"] {
        write(&path, |w| w.write_all(text.as_bytes())).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
    }
    assert_eq!(names(dir.path()), ["a"]);
}

#[test]
fn a_failure_keeps_the_old_file_and_leaves_no_other() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    fs::write(&path, "old").unwrap();
    for target in [path.clone(), dir.path().join("b")] {
        let error = write(&target, |w| {
            w.write_all(&[0; 100_000])?;
            Err(io::Error::other("the disk is full"))
        });
        let message = error.unwrap_err().to_string();
        assert_eq!(message, format!("cannot write {}: the disk is full", target.display()));
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(names(dir.path()), ["a"]);
}

#[test]
fn files_are_written_together_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| dir.path().join(name));
    let text = |path: &Path| write(path, |w| w.write_all(b"new"));
    let failed = write_together(|| {
        text(&a)?;
        assert_eq!(names(dir.path()).len(), 1, "a temporary file");
        write(&b, |_| Err(io::Error::other("the disk is full")))
    });
    assert!(matches!(failed, Err(Error::Write { path, .. }) if path == b));
    assert_eq!(names(dir.path()), [""; 0]);
    write_together(|| text(&a).and(text(&b))).unwrap();
    assert_eq!(names(dir.path()), ["a", "b"]);
    // Files that are written afterwards stand alone again.
    fs::remove_file(&a).unwrap();
    text(&a).unwrap();
    assert_eq!(names(dir.path()), ["a", "b"]);
}

#[test]
fn the_seal_comes_last_and_is_not_there_before() {
    let dir = tempfile::tempdir().unwrap();
    let [seal, b] = ["seal", "b"].map(|name| dir.path().join(name));
    let text = |path: &Path, text: &'static str| write(path, |w| w.write_all(text.as_bytes()));
    let both = |new| replace_together(&seal, || text(&seal, new).and(text(&b, new)));
    both("1").unwrap();
    both("2").unwrap();
    assert_eq!((names(dir.path()), fs::read_to_string(&seal).unwrap()), (vec!["b".into(), "seal".into()], "2".into()));
    let failed = replace_together(&seal, || {
        text(&seal, "3")?;
        write(&b, |_| Err(io::Error::other("the disk is full")))
    });
    assert!(failed.is_err());
    assert_eq!((names(dir.path()), fs::read_to_string(&seal).unwrap()), (vec!["b".into(), "seal".into()], "2".into()));
    // Nothing can be renamed to a folder that is not empty: as if the program were killed there.
    fs::remove_file(&b).unwrap();
    let killed = replace_together(&seal, || {
        text(&seal, "4").and(text(&b, "4"))?;
        fs::create_dir_all(b.join("full")).unwrap();
        Ok(())
    });
    assert!(killed.is_err());
    assert_eq!(names(dir.path()), [".multiscopic-seal", "b"]);
    assert_eq!(fs::read_to_string(crate::files::output::broken_seal(&seal)).unwrap(), "2");
    fs::remove_dir_all(&b).unwrap();
    both("5").unwrap();
    assert_eq!((names(dir.path()), fs::read_to_string(&seal).unwrap()), (vec!["b".into(), "seal".into()], "5".into()));
}

#[test]
fn the_error_names_the_missing_folder() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("none/a.pfm");
    let message = write(&path, |_| Ok(())).unwrap_err().to_string();
    assert!(message.starts_with(&format!("cannot write {}: ", path.display())), "{message}");
    assert!(message.contains(&format!("directory {}", dir.path().join("none").display())), "{message}");
    assert!(!message.contains(".multiscopic-"), "{message}");
    assert!(matches!(write(dir.path(), |_| Ok(())), Err(Error::Write { .. })));
    assert!(matches!(write(Path::new(""), |_| Ok(())), Err(Error::Write { .. })));
}

#[cfg(unix)]
#[test]
fn new_files_get_the_usual_permissions_and_old_ones_keep_theirs() {
    use std::os::unix::fs::PermissionsExt;
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let dir = tempfile::tempdir().unwrap();
    let (usual, path) = (dir.path().join("usual"), dir.path().join("a"));
    fs::write(&usual, "").unwrap();
    write(&path, |_| Ok(())).unwrap();
    assert_eq!(mode(&path), mode(&usual));
    fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
    write(&path, |_| Ok(())).unwrap();
    assert_eq!(mode(&path), 0o640);
    fs::set_permissions(&path, Permissions::from_mode(0o444)).unwrap();
    assert!(write(&path, |_| Ok(())).unwrap_err().to_string().ends_with("permission denied"));
}

#[cfg(unix)]
#[test]
fn symbolic_links_are_followed() {
    let dir = tempfile::tempdir().unwrap();
    let (path, link) = (dir.path().join("a"), dir.path().join("link"));
    fs::write(&path, "old").unwrap();
    std::os::unix::fs::symlink("a", &link).unwrap();
    write(&link, |w| w.write_all(b"new")).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "new");
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
}

#[cfg(target_os = "linux")]
#[test]
fn devices_and_open_files_are_not_replaced() {
    use std::os::{fd::AsRawFd, unix::fs::FileTypeExt};
    write(Path::new("/dev/null"), |w| w.write_all(b"gone")).unwrap();
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());

    let mut open = tempfile::NamedTempFile::new().unwrap();
    open.write_all(b"kept ").unwrap();
    write(Path::new(&format!("/dev/fd/{}", open.as_file().as_raw_fd())), |w| w.write_all(b"new")).unwrap();
    assert_eq!(fs::read_to_string(open.path()).unwrap(), "kept new");
}

#[cfg(target_os = "linux")]
#[test]
fn a_closed_pipe_is_not_an_error() {
    use std::os::fd::AsRawFd;
    let (reader, writer) = io::pipe().unwrap();
    drop(reader);
    write(Path::new(&format!("/dev/fd/{}", writer.as_raw_fd())), |w| w.write_all(b"too much")).unwrap();
}

#[test]
fn a_folder_is_made_completely_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig");
    let write_a_file = |folder: &Path| {
        fs::write(folder.join("a"), "a").unwrap();
        Ok(())
    };
    let failed = write_folder(&path, |folder| {
        write_a_file(folder)?;
        assert!(!path.exists());
        Err::<(), _>(Error::Usage("the camera is gone".into()))
    });
    assert!(failed.unwrap_err().to_string().contains("camera"));
    assert_eq!(names(dir.path()), [""; 0]);
    write_folder(&path, write_a_file).unwrap();
    assert_eq!((names(dir.path()), names(&path)), (vec!["rig".into()], vec!["a".into()]));
    // Whatever is there is kept, unless it is an empty folder.
    assert!(write_folder(&path, write_a_file).unwrap_err().to_string().contains("is there already"));
    assert!(write_folder(&path.join("a"), write_a_file).unwrap_err().to_string().contains("is there already"));
    fs::remove_file(path.join("a")).unwrap();
    write_folder(&path, write_a_file).unwrap();
    // Together with a file, or not at all.
    let (other, page) = (dir.path().join("other"), dir.path().join("none/page"));
    let together = |page: &Path| {
        write_together(|| {
            write_folder(&other, write_a_file)?;
            write(page, |_| Ok(()))
        })
    };
    together(&page).unwrap_err();
    assert_eq!(names(dir.path()), ["rig"]);
    together(&dir.path().join("page")).unwrap();
    assert_eq!((names(dir.path()).len(), names(&other)), (3, vec!["a".into()]));
    assert!(matches!(write_folder(&dir.path().join("none/rig"), write_a_file), Err(Error::Write { .. })));
}

#[test]
fn checks_without_writing() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b, again] = ["a", "b", "./a"].map(|name| dir.path().join(name));
    let files = || fs::read_dir(dir.path()).unwrap().count();
    fs::write(&a, "old").unwrap();
    check(&[&a, &b, Path::new("/dev/null")], &[]).unwrap();
    assert_eq!((files(), fs::read_to_string(&a).unwrap()), (1, "old".into()));

    let message = |outputs: &[&Path], inputs: &[&Path]| check(outputs, inputs).unwrap_err().to_string();
    assert!(message(&[&a, &again], &[]).contains("a is given for two outputs"));
    assert!(message(&[&b, &dir.path().join("./b")], &[]).contains("b is given for two outputs"));
    assert!(message(&[&b, &again], &[&a]).contains("a would replace the input"));
    let nowhere = dir.path().join("none/a");
    assert!(message(&[&b, &nowhere], &[]).starts_with(&format!("cannot write {}: no file can be made", nowhere.display())));
    assert!(message(&[dir.path()], &[]).starts_with(&format!("cannot write {}: ", dir.path().display())));
    assert_eq!(files(), 1);
}
