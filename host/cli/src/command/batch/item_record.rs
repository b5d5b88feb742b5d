//! The record of an item that is done, with fingerprints of its files.

use std::{
    fmt::Write as _,
    fs,
    io::{self, Read},
    path::{Path, PathBuf},
};

use multiscopic::{
    Error, Result,
    files::{input, output},
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use sha2::{Digest, Sha256};

use super::run_settings::RunSettings;

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
    use super::*;

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
