//! The contents of a batch's folder: the settings that decide all results alike, and a record of each item that is done, with
//! fingerprints of its files.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    fs,
    io::{self, Read},
    path::{Path, PathBuf},
};

use clap::{ArgMatches, Command, parser::ValueSource};
use multiscopic::{
    Error, Result,
    files::{input, output},
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use sha2::{Digest, Sha256};

/// Options that say which items there are and where they go, or how fast it goes. They decide no results.
const OTHERS: [&str; 10] =
    ["directories", "list", "results", "scenes", "shard", "max_memory", "max_pixels", "quiet", "simd", "threads"];

/// A command, its version, and its options that decide results.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunSettings {
    /// The name of the command.
    pub command: String,
    /// The version of the program.
    pub version: String,
    /// The values of the options that were given, by their names.
    pub parameters: BTreeMap<String, Vec<String>>,
}

impl RunSettings {
    /// Those of the command that was run, whose arguments were parsed.
    pub fn given(program: &Command, arguments: &ArgMatches) -> RunSettings {
        let (name, arguments) = arguments.subcommand().expect("a command is required");
        let command = program.find_subcommand(name).expect("it was parsed");
        let options = command.get_arguments().map(|option| option.get_id().as_str()).filter(|id| !OTHERS.contains(id));
        let given = options.filter(|id| arguments.value_source(id) == Some(ValueSource::CommandLine));
        let values = |id: &str| arguments.get_raw(id).into_iter().flatten().map(|value| value.to_string_lossy().into()).collect();
        RunSettings {
            command: name.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            parameters: given.map(|id| (id.to_owned(), values(id))).collect(),
        }
    }

    /// Returns what is different in other settings, if anything is.
    pub fn difference(&self, other: &RunSettings) -> Option<String> {
        if self.command != other.command {
            return Some(format!("the results of `{}`, not of `{}`", other.command, self.command));
        }
        if self.version != other.version {
            return Some(format!("results of version {}, not {}", other.version, self.version));
        }
        let names: BTreeSet<&String> = self.parameters.keys().chain(other.parameters.keys()).collect();
        let name = names.into_iter().find(|name| self.parameters.get(*name) != other.parameters.get(*name))?;
        let value =
            |settings: &RunSettings| settings.parameters.get(name).map_or("its default".into(), |values| values.join(","));
        let option = name.replace('_', "-");
        Some(format!("results with --{option} as {}, not {}", value(other), value(self)))
    }
}

/// The largest file in bytes. The longest list of rigs needs less, with quotes and a line for each.
const MAX_BYTES: u64 = 1 << 25;

/// The settings and all items of a run, those of other shares too.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunFile {
    /// The settings that decide the results of all items.
    pub run: RunSettings,
    /// The names of the items in their order.
    pub items: Vec<String>,
}

impl RunFile {
    /// Reads that of a folder of results.
    ///
    /// # Errors
    /// [`Error::Read`], and [`Error::Format`] if it is something else.
    pub fn read(results: &Path) -> Result<RunFile> {
        let path = path(results);
        let bytes = input::read_at_most(&path, MAX_BYTES).map_err(|error| match error {
            Error::Read { source, .. } if source.kind() == io::ErrorKind::NotFound && results.is_dir() => Error::Format {
                path: results.into(),
                found: "a folder without run.json".into(),
                expected: "the --results of `match --list` or `evaluate`".into(),
            },
            error => error,
        })?;
        serde_json::from_slice(&bytes).map_err(|error| Error::Format {
            path,
            found: format!("something else ({error})"),
            expected: "what `match --list` and `evaluate --results` write".into(),
        })
    }

    /// Writes it to a folder of results, which is made if need be, unless it is there. Replaces that of a run with other settings
    /// or items.
    ///
    /// # Errors
    /// [`Error::Write`], and [`Error::Usage`] if the results there are those of another command.
    pub fn write(&self, results: &Path) -> Result<()> {
        fs::create_dir_all(results).map_err(|source| Error::Write { path: results.into(), source })?;
        // What cannot be read is replaced.
        if let Ok(before) = RunFile::read(results) {
            if before.run.command != self.run.command {
                let (results, other) = (results.display(), &before.run.command);
                return Err(Error::Usage(format!("{results} has the results of `{other}`: give another folder")));
            }
            if before == *self {
                return Ok(());
            }
        }
        let json = serde_json::to_string_pretty(self).expect("strings");
        output::write(&path(results), |writer| writeln!(writer, "{json}"))
    }
}

fn path(results: &Path) -> PathBuf {
    results.join("run.json")
}

/// The work on an item, and its outcome. It is written last: an item with a record is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ItemRecord<R> {
    /// The item's name.
    pub item: String,
    /// The settings that decided the results, besides the inputs.
    pub run: RunSettings,
    /// The files that were read.
    pub inputs: Fingerprint,
    /// The files that were written, in the folder of the record.
    pub outputs: Vec<OutputRecord>,
    /// The results.
    pub results: R,
    /// The time that it took.
    pub seconds: f64,
}

/// A file that was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputRecord {
    /// Its name.
    pub file: String,
    /// Its contents.
    #[serde(flatten)]
    pub contents: Fingerprint,
}

impl OutputRecord {
    /// That of a file that is there.
    pub fn of(path: &Path) -> Result<OutputRecord> {
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(OutputRecord { file, contents: Fingerprint::of_file(path)? })
    }
}

impl<R> ItemRecord<R> {
    /// The name of the file.
    const FILE_NAME: &str = "record.json";

    /// The folder of an item of this name.
    pub fn folder(results: &Path, item: &str) -> PathBuf {
        results.join(item)
    }

    /// The file in the folder of an item.
    pub fn path(folder: &Path) -> PathBuf {
        folder.join(Self::FILE_NAME)
    }

    /// Returns true if the outputs in a folder are there and have the bytes that they should have.
    pub fn has_outputs(&self, folder: &Path) -> bool {
        let has_bytes = |metadata: fs::Metadata, output: &OutputRecord| metadata.len() == output.contents.bytes;
        self.outputs.iter().all(|output| fs::metadata(folder.join(&output.file)).is_ok_and(|there| has_bytes(there, output)))
    }

    /// Refuses outputs in a folder that are not those of the record.
    pub fn check_outputs(&self, folder: &Path) -> Result<()> {
        for output in &self.outputs {
            let path = folder.join(&output.file);
            if Fingerprint::of_file(&path)? != output.contents {
                let found = "other contents than those in its record".into();
                let expected = "what was written: remove the record, and do the item again".into();
                return Err(Error::Format { path, found, expected });
            }
        }
        Ok(())
    }
}

impl<R: DeserializeOwned> ItemRecord<R> {
    /// Reads the record in the folder of an item. `None` if there is none.
    ///
    /// # Errors
    /// [`Error::Read`], and [`Error::Format`] if it is not a record.
    pub fn read(folder: &Path) -> Result<Option<ItemRecord<R>>> {
        let path = Self::path(folder);
        let text = match input::read_text(&path) {
            Err(Error::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
            text => text?,
        };
        serde_json::from_str(&text).map(Some).map_err(|error| Error::Format {
            path,
            found: format!("no record ({error})"),
            expected: "that of an item that is done: do it again".into(),
        })
    }
}

impl<R: Serialize> ItemRecord<R> {
    /// Writes the record into the folder of the item.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let json = serde_json::to_string_pretty(self).expect("numbers and strings");
        output::write(&Self::path(folder), |writer| writeln!(writer, "{json}"))
    }
}

/// The contents of files.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// The number of bytes in all of them.
    pub bytes: u64,
    /// The SHA-256 of them, as hexadecimal digits. That of several files is the one of the SHA-256 of each, in their order.
    pub sha256: String,
}

impl Fingerprint {
    /// That of a file.
    pub fn of_file(path: &Path) -> Result<Fingerprint> {
        let (bytes, digest) = digest(path)?;
        Ok(Fingerprint { bytes, sha256: hexadecimal(&digest) })
    }

    /// That of several files in their order.
    pub fn of_files<'a>(paths: impl IntoIterator<Item = &'a Path>) -> Result<Fingerprint> {
        let (mut all, mut sum) = (Sha256::new(), 0);
        for path in paths {
            let (bytes, digest) = digest(path)?;
            all.update(digest);
            sum += bytes;
        }
        Ok(Fingerprint { bytes: sum, sha256: hexadecimal(&all.finalize()) })
    }
}

/// The number of bytes of a file, and their SHA-256.
fn digest(path: &Path) -> Result<(u64, [u8; 32])> {
    let failed = |source| Error::Read { path: path.into(), source };
    let mut file = input::open(path)?;
    let (mut sha256, mut bytes, mut part) = (Sha256::new(), 0, vec![0; 1 << 16]);
    loop {
        match file.read(&mut part).map_err(failed)? {
            0 => return Ok((bytes, sha256.finalize().into())),
            read => {
                sha256.update(&part[..read]);
                bytes += read as u64;
            }
        }
    }
}

fn hexadecimal(digest: &[u8]) -> String {
    digest.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn settings(line: &str) -> RunSettings {
        let program = crate::Cli::command();
        let arguments = program.clone().try_get_matches_from(line.split(' ')).unwrap();
        RunSettings::given(&program, &arguments)
    }

    #[test]
    fn settings_are_what_decides_results() {
        let first =
            settings("multiscopic match --list a.txt --results a -o d.pfm --method sgm --num-disparities 64 --fill background");
        let same = "multiscopic match --fill=background --disparity_range=64 --list b.txt --results b --shard 1/2 --threads 1 -o d.pfm \
             --method sgm --quiet";
        assert_eq!(settings(same), first);
        let parameters: Vec<(&str, String)> =
            first.parameters.iter().map(|(name, values)| (name.as_str(), values.join(","))).collect();
        let expected = [("fill", "background"), ("method", "sgm"), ("num_disparities", "64"), ("output", "d.pfm")];
        assert_eq!(parameters, expected.map(|(name, value)| (name, value.to_owned())));

        let other = settings("multiscopic match --list a.txt --results a -o d.pfm --method sgm --num-disparities 64 --align");
        assert_eq!(first.difference(&first), None);
        assert_eq!(first.difference(&other).unwrap(), "results with --align as true, not its default");
        let other = RunSettings { version: "0.0.1".into(), ..first.clone() };
        assert!(first.difference(&other).unwrap().starts_with("results of version 0.0.1, not "));
        let other = settings("multiscopic evaluate data --dataset tsukuba --results a --methods bm,sgm");
        assert_eq!(first.difference(&other).unwrap(), "the results of `evaluate`, not of `match`");
        assert_eq!(other.parameters["methods"], ["bm", "sgm"]);
        assert_eq!(other.parameters.len(), 2);
    }

    #[test]
    fn the_options_that_decide_nothing_exist() {
        let program = crate::Cli::command();
        let all: Vec<String> = ["match", "evaluate"]
            .iter()
            .flat_map(|name| program.find_subcommand(name).unwrap().get_arguments().map(|option| option.get_id().to_string()))
            .chain(program.get_arguments().map(|option| option.get_id().to_string()))
            .collect();
        assert!(OTHERS.iter().all(|other| all.iter().any(|id| id == other)), "{all:?}");
    }

    #[test]
    fn fingerprints_are_sha256() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        std::fs::write(path("abc"), "abc").unwrap();
        std::fs::write(path("none"), "").unwrap();
        // The example of FIPS 180-2.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(Fingerprint::of_file(&path("abc")).unwrap(), Fingerprint { bytes: 3, sha256: abc.into() });
        let [abc, none] = ["abc", "none"].map(path);
        let both = Fingerprint::of_files([&*abc, &*none]).unwrap();
        assert_eq!(both.bytes, 3);
        assert_ne!(both, Fingerprint::of_files([&*none, &*abc]).unwrap());
        assert!(matches!(Fingerprint::of_file(&path("other")), Err(Error::Read { .. })));
    }
}
