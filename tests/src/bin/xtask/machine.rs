//! A virtual machine with cameras, and the tests that run in it: Linux with camera drivers from Debian's packages, and its
//! initial file system as a cpio archive.

use anyhow::{Context, Result, bail, ensure};
use cpio::{
    NewcBuilder,
    newc::{self, ModeFileType},
};
use multiscopic_tests::test_images::real_data::{self, Dataset};
use object::{Object, ObjectSection};
use std::{
    collections::{BTreeMap, HashSet},
    env::consts::ARCH,
    fs::{self, File},
    io::Write,
    path::{Component, Path, PathBuf},
    process::Stdio,
    time::Duration,
};

use crate::{
    system::{self, built_program, built_test, command, exit_code_within, optimized_tests, read, run},
    tools::{self, Tool, debian},
};

/// The time limit of a run. Only a hung one reaches it.
const LIMIT: Duration = Duration::from_secs(1800);

/// The machine's RAM.
const MEMORY: &str = "1G";

/// The texts that the machine prints before and after the tests' output.
const UP: &str = "guest: up ";
const EXIT_CODE: &str = "guest: exit code ";

/// The test program that needs cameras.
const TEST: &str = "cameras";

/// The tests of `--all` alone, by the beginnings of their names: the slowest captures that fail, which simulated hardware tests
/// too. They take half of the time.
const LONG: [&str; 4] = [
    "capture_command::arm_",
    "capture_command::camera_starves",
    "capture_command::interrupted::Connecting",
    "capture_command::interrupted::Returning",
];

/// Runs the camera tests in release, with or without the long ones. Without a virtual machine they are reported as ignored.
pub fn run_camera_tests(with_long: bool) -> Result<()> {
    if let Some(reason) = missing() {
        println!("v4l2: no virtual machine: {reason}");
        return run(optimized_tests().args(["--test", TEST]));
    }
    let mut machine = Machine::new()?;
    let program = built_program()?;
    machine.add_program(&program)?;
    machine.add_folder(&system::root().join("tests/golden"))?;
    let mut variables = format!("MULTISCOPIC_CAMERAS=1 MULTISCOPIC_BINARY='{}'", program.display());
    if let Some(root) = real_data::root() {
        machine.add_folder(&root.join(Dataset::Tsukuba.name()))?;
        variables += &format!(" MULTISCOPIC_DATA='{}'", root.display());
    }
    let test = built_test(TEST)?;
    machine.add_program(&test)?;
    // The tests share the devices and change their settings, so they run one at a time.
    let skipped: String = LONG.iter().filter(|_| !with_long).map(|name| format!(" --skip {name}")).collect();
    machine.run(&format!("cd /tmp; {variables} '{}' --test-threads 1 --color never{skipped}", test.display()))
}

/// Returns the reason that no virtual machine can run here; `None` if one can.
fn missing() -> Option<String> {
    if ARCH != "x86_64" || !debian::is_here() {
        return Some("its kernel is Debian's for x86_64, and this is another system".into());
    }
    if debian::can_install() {
        return None;
    }
    let refused = [&tools::QEMU_X86].into_iter().chain(&LINUX_TOOLS).find_map(|tool| tool.install().err());
    match Linux::current() {
        _ if refused.is_some() => refused.map(|refusal| format!("{refusal:#}")),
        None => Some("no list of packages; run `sudo apt-get update` first".into()),
        Some(_) => None,
    }
}

/// A virtual machine under construction.
struct Machine {
    kernel: Linux,
    files: Archive,
}

impl Machine {
    /// A machine with drivers and a shell only.
    fn new() -> Result<Machine> {
        let kernel = Linux::install()?;
        let mut files = Archive::default();
        files.copy(&system::root().join("tests/v4l2/init.sh"), Path::new("init"))?;
        Ok(Machine { kernel, files })
    }

    /// Copies a program of the host and its shared libraries, under the same paths.
    fn add_program(&mut self, program: &Path) -> Result<()> {
        self.files.copy(program, program)?;
        // `libc.so.6 => /lib/x86_64-linux-gnu/libc.so.6 (0x...)`, and the loader without an arrow.
        let listed = read(command("ldd", [""; 0]).arg(program))?;
        let paths = listed.split_whitespace().filter(|word| word.starts_with('/'));
        paths.map(Path::new).try_for_each(|path| self.files.copy(path, path))
    }

    /// Copies the files of a folder of the host, under the same paths.
    fn add_folder(&mut self, folder: &Path) -> Result<()> {
        let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
        let paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<PathBuf>>>()?;
        paths.iter().filter(|path| path.is_file()).try_for_each(|path| self.files.copy(path, path))
    }

    /// Runs a shell script and prints its output. Fails unless its exit code is 0.
    fn run(mut self, script: &str) -> Result<()> {
        self.files.file(Path::new("tests.sh"), script.as_bytes());
        let folder = system::target().join("v4l2");
        let (archive, log) = (folder.join("machine.cpio"), folder.join("output.txt"));
        fs::create_dir_all(&folder)?;
        // Linux unpacks concatenated archives one after the other.
        let mut system = fs::read(&self.kernel.system)?;
        system.extend(self.files.to_bytes()?);
        fs::write(&archive, system)?;

        // Always emulate, so that runs behave alike with and without hardware virtualisation.
        let machine = ["-machine", "pc", "-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", MEMORY];
        let mut emulator = tools::QEMU_X86.install()?.command(&machine)?;
        emulator.args(["-nodefaults", "-display", "none", "-no-reboot", "-serial", "stdio"]);
        emulator.args(["-append", "console=ttyS0 quiet panic=-1 mitigations=off nokaslr"]);
        emulator.arg("-kernel").arg(&self.kernel.image).arg("-initrd").arg(&archive);
        let output = File::create(&log).with_context(|| format!("cannot make {}", log.display()))?;
        emulator.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output);
        let ended = exit_code_within(&mut emulator.spawn().context("cannot start the emulator")?, LIMIT);

        let text = String::from_utf8_lossy(&fs::read(&log)?).replace('\r', "");
        let output = text.find(UP).map_or(&*text, |start| &text[start..]);
        let (output, code) = output.rsplit_once(EXIT_CODE).unwrap_or((output, "none"));
        let code = code.lines().next().unwrap_or_default();
        print!("{output}");
        ended.with_context(|| format!("the virtual machine with Linux {}", self.kernel.version))?;
        ensure!(
            code == "0",
            "the tests in the virtual machine ended with exit code {}; {} has the whole output",
            code,
            log.display()
        );
        Ok(())
    }
}

/// The tools that unpack the kernel and build its loopback module.
const LINUX_TOOLS: [Tool; 3] = [tools::CC, tools::MAKE, tools::XZ];

/// The drivers and their parameters: vivid generates images and faults, v4l2loopback shows the frames it is
/// fed.
const DRIVERS: [(&str, &str); 2] = [
    ("vivid", "n_devs=3 node_types=0x1,0x1,0x1 num_inputs=1,1,1 input_types=0,0,0 multiplanar=1,1,2"),
    ("v4l2loopback", "devices=5 video_nr=10,11,12,13,14 exclusive_caps=1,1,1,1,1 max_buffers=8"),
];

/// The names of the files in the folder of Linux.
const IMAGE: &str = "kernel";
const SYSTEM: &str = "system.cpio";

/// The files that a virtual machine boots from.
struct Linux {
    /// The kernel image.
    image: PathBuf,
    /// The archive with busybox, the drivers, and the order in which they are loaded.
    system: PathBuf,
    /// The kernel's version.
    version: String,
}

impl Linux {
    /// The kernel, unpacked from Debian's current one on first use.
    fn install() -> Result<Linux> {
        let folder = system::target().join("tools/linux");
        let marker = folder.join("version");
        if !marker.is_file() {
            if debian::can_install() {
                debian::update()?;
            }
            let version = Linux::current().context("no package linux-image-amd64 is known; run `apt-get update` as root")?;
            make(&folder, &version).with_context(|| format!("cannot make {}", folder.display()))?;
            fs::write(&marker, version)?;
        }
        let version = fs::read_to_string(&marker)?;
        Ok(Linux { image: folder.join(IMAGE), system: folder.join(SYSTEM), version })
    }

    /// The current kernel's version in the package lists.
    fn current() -> Option<String> {
        let depends = depends("linux-image-amd64").ok()?;
        depends.iter().find_map(|package| package.strip_prefix("linux-image-").map(str::to_owned))
    }
}

/// The packages that `package` depends on.
fn depends(package: &str) -> Result<Vec<String>> {
    let listed = read(&mut command("apt-cache", ["depends", package]))?;
    Ok(listed.lines().filter_map(|line| line.trim().strip_prefix("Depends: ").map(str::to_owned)).collect())
}

/// Puts the files of the kernel `version` into `folder`.
fn make(folder: &Path, version: &str) -> Result<()> {
    for tool in &LINUX_TOOLS {
        tool.install()?;
    }
    let (image, headers) = (format!("linux-image-{version}"), format!("linux-headers-{version}"));
    let parts = depends(&headers)?;
    let parts = parts.iter().filter(|part| part.starts_with("linux-headers-") || part.starts_with("linux-kbuild-"));
    let packages = [&*image, &*headers, "v4l2loopback-dkms", "busybox-static"].into_iter().chain(parts.map(String::as_str));
    let files = folder.join("files");
    fs::create_dir_all(folder)?;
    debian::extract(packages, &files)?;

    let loopback = make_loopback(&files, version)?;
    fs::write(folder.join(IMAGE), decompressed(&files, version)?)?;
    fs::write(folder.join(SYSTEM), system(&files, version, &loopback)?)?;
    fs::remove_dir_all(&files)?;
    Ok(())
}

/// Compiles the module v4l2loopback with the headers in `files`.
fn make_loopback(files: &Path, version: &str) -> Result<PathBuf> {
    let headers = files.join(format!("usr/src/linux-headers-{version}"));
    // The Makefile includes the common headers by their installed path.
    let makefile = headers.join("Makefile");
    let text = fs::read_to_string(&makefile).with_context(|| format!("cannot read {}", makefile.display()))?;
    fs::write(&makefile, text.replace("include /usr/src/", &format!("include {}/usr/src/", files.display())))?;
    let sources = fs::read_dir(files.join("usr/src"))?.flatten().map(|entry| entry.path());
    let is_loopback = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("v4l2loopback-"));
    let source = sources.into_iter().find(is_loopback).context("the package v4l2loopback-dkms has no source")?;
    let make = tools::MAKE.install()?;
    let mut make = make.command(&["--silent", "--directory"])?;
    read(make.arg(&headers).arg(format!("M={}", source.display())).arg("modules"))?;
    Ok(source.join("v4l2loopback.ko"))
}

/// The uncompressed kernel from its boot image, which saves the emulator seconds of decompression.
fn decompressed(files: &Path, version: &str) -> Result<Vec<u8>> {
    let bytes = fs::read(files.join(format!("boot/vmlinuz-{version}")))?;
    let magic = b"\xFD7zXZ\0";
    let payload = files.join("payload.xz");
    for start in (0..bytes.len().saturating_sub(magic.len())).filter(|&start| bytes[start..].starts_with(magic)) {
        fs::write(&payload, &bytes[start..])?;
        // xz reports an error about the data after the payload, but has written all of it.
        let xz = tools::XZ.install()?.command(&["--decompress", "--stdout", "--single-stream"])?.arg(&payload).output()?;
        if xz.stdout.starts_with(b"\x7FELF") {
            return Ok(xz.stdout);
        }
    }
    // Compressed otherwise: boot the image as it is.
    Ok(bytes)
}

/// The archive with busybox, the drivers and the modules they depend on, and the order in which they are
/// loaded.
fn system(files: &Path, version: &str, loopback: &Path) -> Result<Vec<u8>> {
    let modules = Modules { folder: files.join("lib/modules").join(version), loopback: loopback.into() };
    let mut archive = Archive::default();
    let (mut order, mut loaded) = (String::new(), HashSet::new());
    for (driver, parameters) in DRIVERS {
        modules.add(driver, parameters, &mut archive, &mut order, &mut loaded)?;
    }
    archive.file(Path::new("modules/order"), order.as_bytes());
    ["dev", "proc", "sys", "tmp"].into_iter().for_each(|folder| archive.folder(Path::new(folder)));
    archive.copy(&files.join("bin/busybox"), Path::new("bin/busybox"))?;
    archive.to_bytes()
}

/// The kernel's modules.
struct Modules {
    folder: PathBuf,
    loopback: PathBuf,
}

impl Modules {
    /// Adds the module `name` after its dependencies, unless it was added before.
    fn add(
        &self,
        name: &str,
        parameters: &str,
        archive: &mut Archive,
        order: &mut String,
        loaded: &mut HashSet<String>,
    ) -> Result<()> {
        if !loaded.insert(name.replace('-', "_")) {
            return Ok(());
        }
        let Some(path) = self.find(name)? else { return Ok(()) };
        let contents = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        for needed in needed(&contents).with_context(|| path.display().to_string())? {
            self.add(&needed, "", archive, order, loaded)?;
        }
        archive.file(&Path::new("modules").join(format!("{name}.ko")), &contents);
        *order += &format!("{name}.ko {parameters}\n");
        Ok(())
    }

    /// The file of the module `name`; `None` if it is built into the kernel.
    fn find(&self, name: &str) -> Result<Option<PathBuf>> {
        if name == "v4l2loopback" {
            return Ok(Some(self.loopback.clone()));
        }
        let is_it = |file: &str| file.replace('-', "_") == format!("{}.ko", name.replace('-', "_"));
        let mut folders = vec![self.folder.join("kernel")];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))? {
                let path = entry?.path();
                match path.file_name().map(|file| file.to_string_lossy()) {
                    _ if path.is_dir() => folders.push(path),
                    Some(file) if is_it(&file) => return Ok(Some(path)),
                    _ => {}
                }
            }
        }
        let builtin = fs::read_to_string(self.folder.join("modules.builtin"))?;
        let is_builtin = builtin.lines().filter_map(|line| line.rsplit('/').next()).any(is_it);
        ensure!(is_builtin, "the kernel has no module {name}");
        Ok(None)
    }
}

/// The dependencies that a module declares.
fn needed(module: &[u8]) -> Result<Vec<String>> {
    let file = object::File::parse(module)?;
    let Some(section) = file.section_by_name(".modinfo") else { bail!("a module without the section .modinfo") };
    let words = section.data()?.split(|&byte| byte == 0).map(String::from_utf8_lossy);
    let depends = words.filter_map(|word| word.strip_prefix("depends=").map(str::to_owned));
    Ok(depends
        .flat_map(|names| names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect::<Vec<_>>())
        .collect())
}

/// Everybody may read and execute every file.
const PERMISSIONS: u32 = 0o755;

/// Files and folders by their path without a leading slash. In alphabetical order, folders come before their
/// contents.
#[derive(Default)]
struct Archive {
    entries: BTreeMap<String, Entry>,
}

enum Entry {
    Folder,
    File(Vec<u8>),
}

impl Archive {
    /// Adds an empty folder and its parents.
    fn folder(&mut self, path: &Path) {
        for folder in path.ancestors().map(name).filter(|name| !name.is_empty()) {
            self.entries.entry(folder).or_insert(Entry::Folder);
        }
    }

    /// Adds an executable file and its parent folders.
    fn file(&mut self, path: &Path, contents: &[u8]) {
        if let Some(folder) = path.parent() {
            self.folder(folder);
        }
        self.entries.insert(name(path), Entry::File(contents.into()));
    }

    /// Adds a copy of the file `from`.
    fn copy(&mut self, from: &Path, to: &Path) -> Result<()> {
        self.file(to, &fs::read(from).with_context(|| format!("cannot read {}", from.display()))?);
        Ok(())
    }

    /// The archive in cpio's newc format.
    fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        for (index, (name, entry)) in self.entries.iter().enumerate() {
            let (kind, contents) = match entry {
                Entry::Folder => (ModeFileType::Directory, [].as_slice()),
                Entry::File(contents) => (ModeFileType::Regular, contents.as_slice()),
            };
            // Linux treats entries with equal inode numbers as links to one file.
            let header = NewcBuilder::new(name).ino(index as u32 + 1).mode(PERMISSIONS).set_mode_file_type(kind).nlink(1);
            let mut writer = header.write(&mut bytes, contents.len() as u32);
            writer.write_all(contents)?;
            writer.finish()?;
        }
        newc::trailer(&mut bytes)?;
        Ok(bytes)
    }
}

/// A path as archives write it: relative to the root.
fn name(path: &Path) -> String {
    let names = path.components().filter(|component| matches!(component, Component::Normal(_)));
    names.map(|name| name.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    use cpio::NewcReader;
    use std::io::Read;

    #[test]
    fn folders_come_before_what_they_contain() {
        let mut archive = Archive::default();
        archive.file(Path::new("/a/b/d"), b"");
        archive.file(Path::new("/a/b/c"), b"12345");
        let mut bytes: &[u8] = &archive.to_bytes().unwrap();
        let mut entries = Vec::new();
        loop {
            let mut reader = NewcReader::new(&mut bytes).unwrap();
            if reader.entry().is_trailer() {
                break;
            }
            let mut contents = String::new();
            reader.read_to_string(&mut contents).unwrap();
            entries.push((reader.entry().name().to_owned(), reader.entry().mode(), contents));
            reader.finish().unwrap();
        }
        let entry = |name: &str, mode, contents: &str| (name.to_owned(), mode, contents.to_owned());
        let (folder, file) = (0o040_755, 0o100_755);
        let expected =
            [entry("a", folder, ""), entry("a/b", folder, ""), entry("a/b/c", file, "12345"), entry("a/b/d", file, "")];
        assert_eq!(entries, expected);
    }
}
