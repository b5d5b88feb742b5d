//! Fingerprints of files.

use std::{fmt::Write as _, io::Read, path::Path};

use multiscopic::{Error, Result, files::input};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

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
