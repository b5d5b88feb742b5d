//! A folder in which tests match the golden views.

use std::{
    fs,
    path::{Path, PathBuf},
};

use multiscopic_tests::{program::Invocation, test_images::golden};

/// The camera of the golden views. Some of their disparities lie beyond infinity.
pub const FOCAL_PX: f64 = 40.0;
pub const BASELINE_MM: f64 = 25.0;
pub const DOFFS: f64 = -1.5;
pub const PRINCIPAL_POINT: [f64; 2] = [23.25, 15.75];

/// A folder for a test's files, and the arguments of a match in it.
pub struct Bench {
    pub dir: tempfile::TempDir,
    pub arguments: Vec<String>,
}

impl Bench {
    /// A match of the golden centre with these golden views, without outputs.
    pub fn new(views: [bool; 4]) -> Bench {
        let dir = tempfile::tempdir().expect("a folder for the test");
        let options = ["--center", "--left", "--right", "--top", "--bottom"];
        let given = [true, views[0], views[1], views[2], views[3]];
        let mut bench = Bench { dir, arguments: vec!["match".into()] };
        for ((option, path), _) in options.into_iter().zip(golden::paths()).zip(given).filter(|(_, given)| *given) {
            bench.add(option, path);
        }
        bench
    }

    pub fn stereo() -> Bench {
        Bench::new([false, true, false, false])
    }

    /// Searches from -3 to 7, so that there are disparities on both sides of infinity.
    pub fn search_around_infinity(&mut self) {
        self.add("--min-disparity", "-3").add("--num-disparities", "11");
    }

    /// Adds the options that describe the golden views' camera.
    pub fn geometry_options(&mut self) {
        let [cx, cy] = PRINCIPAL_POINT;
        self.add("--focal-px", FOCAL_PX.to_string()).add("--baseline-mm", BASELINE_MM.to_string());
        self.add("--doffs", DOFFS.to_string()).add("--principal-point", format!("{cx},{cy}"));
    }

    /// A match of the golden views in a captured folder.
    pub fn rig() -> Bench {
        let mut bench = Bench::new([false; 4]);
        let mut rig = format!(
            "baseline_mm = {BASELINE_MM:?}\nfocal_px = {FOCAL_PX:?}\nprincipal_point = {PRINCIPAL_POINT:?}\ndoffs = {DOFFS:?}\n[images]\n"
        );
        fs::create_dir(bench.path("rig")).expect("a folder");
        for path in golden::paths() {
            let file = path.file_name().and_then(|name| name.to_str()).expect("a name");
            fs::copy(&path, bench.path("rig").join(file)).expect("a copy of a view");
            rig += &format!("{} = {file:?}\n", file.trim_end_matches(".png"));
        }
        bench.file("rig/rig.toml", rig.as_bytes());
        bench.arguments = vec!["match".into(), bench.path("rig").to_str().expect("UTF-8").into()];
        bench
    }

    pub fn add(&mut self, option: &str, value: impl AsRef<Path>) -> &mut Bench {
        self.arguments.extend([option.into(), value.as_ref().to_str().expect("a path in UTF-8").into()]);
        self
    }

    /// Replaces an option's value or adds the option.
    pub fn set(&mut self, option: &str, value: impl AsRef<Path>) -> &mut Bench {
        if let Some(i) = self.arguments.iter().position(|argument| argument == option) {
            self.arguments.drain(i..i + 2);
        }
        self.add(option, value)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, bytes).expect("a file of the test");
        path
    }

    /// Adds an output to a file in the test's folder.
    pub fn output(&mut self, option: &str, name: &str) -> PathBuf {
        let path = self.path(name);
        self.set(option, &path);
        path
    }

    pub fn run(&self) -> Invocation {
        Invocation::new(&self.arguments)
    }

    /// The sorted names of the files in the folder.
    pub fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.dir.path()).expect("the folder of the test");
        let mut names: Vec<String> =
            entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("a name in UTF-8")).collect();
        names.sort();
        names
    }

    /// Runs with `-o` to a missing file and then to an existing one. The message must contain `words` both
    /// times, and no file may appear or change.
    #[track_caller]
    pub fn refused(&mut self, words: &[&str]) {
        self.output("-o", "out.pfm");
        let before = self.files();
        self.run().assert_refused(words);
        assert_eq!(self.files(), before, "no file is left behind");
        let old = self.file("out.pfm", b"what was there");
        let before = self.files();
        self.run().assert_refused(words);
        assert_eq!(self.files(), before, "no file is left behind");
        assert_eq!(fs::read(old).expect("the old file"), b"what was there", "an existing output is untouched");
    }
}
