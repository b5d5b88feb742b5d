//! The settings that decide the results of all items alike, and the file that keeps them.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use clap::{ArgMatches, Command, parser::ValueSource};
use multiscopic::{
    Error, Result,
    files::{input, output},
};
use serde::{Deserialize, Serialize};

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
}
