//! Reading files, within limits.

use std::{
    fs::{self, File, Metadata},
    io::Read,
    path::Path,
};

use serde::de::DeserializeOwned;

use crate::error::{Error, Result, first_line};

/// The longest side of a picture in pixels. It is the core's limit too.
pub(crate) const MAX_SIDE: u32 = u16::MAX as u32;
/// The largest file in bytes, unless pictures may have more than [`Limits::DEFAULT`] pixels.
const MAX_BYTES: u64 = Limits::DEFAULT.max_picture_bytes();
/// The most bytes of a pixel: four channels of 16 bits, and as much again for the format.
const MAX_PIXEL_BYTES: u64 = 16;
/// The largest file of text in bytes. Parsed, it takes many times as much.
const MAX_TEXT_BYTES: u64 = 1 << 22;

/// The size of pictures and maps from which on a reader refuses a file, by its header and before it takes memory for the
/// pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The most pixels of a picture. Whatever it is, no side may have more than 65535.
    pub max_pixels: u64,
}

impl Limits {
    /// The limits unless others are given: 67 million pixels, which are 8192x8192.
    pub const DEFAULT: Limits = Limits { max_pixels: 1 << 26 };

    /// The most bytes of the samples of a picture, twice.
    pub(crate) const fn max_picture_bytes(self) -> u64 {
        self.max_pixels.saturating_mul(MAX_PIXEL_BYTES)
    }

    /// Reads the picture or map in the file `path`. An empty file is an error.
    pub(crate) fn read(self, path: &Path) -> Result<Vec<u8>> {
        read_at_most(path, MAX_BYTES.max(self.max_picture_bytes()))
    }

    /// Refuses an empty or absurdly large picture before any memory is allocated for it.
    pub(crate) fn check_size(self, path: &Path, width: u32, height: u32) -> Result<()> {
        let side = 1..=MAX_SIDE;
        if side.contains(&width) && side.contains(&height) && u64::from(width) * u64::from(height) <= self.max_pixels {
            return Ok(());
        }
        Err(Error::PictureSize { path: path.into(), width, height, max_pixels: self.max_pixels })
    }
}

impl Default for Limits {
    fn default() -> Limits {
        Limits::DEFAULT
    }
}

/// The contents of the file `path`, of at most 1 GiB. An empty file is an error.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    read_at_most(path, MAX_BYTES)
}

/// Opens a file or a pipe.
///
/// # Errors
/// [`Error::Read`], and [`Error::Format`] for a device, such as `/dev/zero`, which may have no end.
pub fn open(path: &Path) -> Result<File> {
    let failed = |source| Error::Read { path: path.into(), source };
    // Before it is opened, which changes some devices.
    if is_device(&fs::metadata(path).map_err(failed)?) {
        return Err(Error::format(path, "a device", "a file or a pipe"));
    }
    File::open(path).map_err(failed)
}

/// The contents of a file or a pipe of at most `most` bytes.
///
/// # Errors
/// [`Error::Read`], and [`Error::Format`] if there are more bytes or none, or for a device. Longer files are refused before
/// memory is taken for them.
pub fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>> {
    let failed = |source| Error::Read { path: path.into(), source };
    let too_long = || {
        let mebibytes = most >> 20;
        Error::format(path, format!("more than {mebibytes} MiB"), format!("at most {mebibytes} MiB"))
    };
    let file = open(path)?;
    let length = file.metadata().map_err(failed)?.len();
    if length > most {
        return Err(too_long());
    }
    // One more byte, so that the end is found without more memory. A pipe has a length of 0, and a file may grow meanwhile.
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length as usize + 1).map_err(|error| failed(error.into()))?;
    file.take(most + 1).read_to_end(&mut bytes).map_err(failed)?;
    match bytes.len() as u64 {
        0 => Err(Error::format(path, "an empty file", "data")),
        n if n > most => Err(too_long()),
        _ => Ok(bytes),
    }
}

/// Returns true if this is a device.
fn is_device(metadata: &Metadata) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        metadata.file_type().is_char_device() || metadata.file_type().is_block_device()
    }
    #[cfg(not(unix))]
    {
        let _ = metadata;
        false
    }
}

/// The text in the file `path`, of at most 4 MiB, without the byte order mark that some editors put first. An empty file is an
/// error.
///
/// # Errors
/// As [`read_at_most`], and [`Error::Format`] if it is not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    let mut bytes = read_at_most(path, MAX_TEXT_BYTES)?;
    if bytes.starts_with("\u{feff}".as_bytes()) {
        bytes.drain(.."\u{feff}".len());
    }
    String::from_utf8(bytes).map_err(|_| Error::format(path, "bytes that are not text", "UTF-8 text"))
}

/// The value in the TOML file `path`, which should be `expected`, such as "a rig.toml".
pub(crate) fn read_toml<T: DeserializeOwned>(path: &Path, expected: &str) -> Result<T> {
    let text = read_text(path)?;
    toml::from_str(&text).map_err(|error| Error::format(path, with_line(&error, &text), expected))
}

/// The error's message with the line it refers to, as the message often does not name the key.
fn with_line(error: &toml::de::Error, text: &str) -> String {
    let Some(before) = error.span().and_then(|span| text.get(..span.start)) else {
        return error.message().into();
    };
    let number = before.matches('\n').count();
    let line = first_line(text.lines().nth(number).unwrap_or_default());
    format!("line {} ({line}): {}", number + 1, error.message())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_names_a_missing_or_empty_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("c.png");
        let message = read(&path).unwrap_err().to_string();
        assert!(message.starts_with(&format!("cannot read {}: ", path.display())), "{message}");
        fs::write(&path, "").unwrap();
        assert_eq!(read(&path).unwrap_err().to_string(), format!("{}: found an empty file, expected data", path.display()));
        assert!(matches!(read(dir.path()), Err(Error::Read { .. })));
        #[cfg(unix)]
        assert_eq!(read(Path::new("/dev/zero")).unwrap_err().to_string(), "/dev/zero: found a device, expected a file or a pipe");
    }

    #[test]
    fn a_text_is_short() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rig.toml");
        fs::write(&path, vec![b'\n'; 1 << 22]).unwrap();
        assert_eq!(read_text(&path).unwrap().len(), 1 << 22);
        fs::write(&path, vec![b'\n'; (1 << 22) + 1]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().ends_with("found more than 4 MiB, expected at most 4 MiB"));
        assert_eq!(read(&path).unwrap().len(), (1 << 22) + 1);
        // No memory is taken for what is too long.
        File::create(&path).unwrap().set_len(MAX_BYTES + 1).unwrap();
        assert!(read(&path).unwrap_err().to_string().ends_with("found more than 1024 MiB, expected at most 1024 MiB"));
    }

    #[test]
    fn a_byte_order_mark_is_no_text() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("list.txt");
        fs::write(&path, "\u{feff}shelf\r\n").unwrap();
        assert_eq!(read_text(&path).unwrap(), "shelf\r\n");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_read_to_its_end() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let text: Vec<u8> = (0..100_000_u32).map(|i| i as u8).collect();
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| fs::write(&path, &text).unwrap());
            assert!(read(&path).unwrap() == text);
            writer.join().unwrap();
        });
    }

    #[test]
    fn empty_and_absurd_sizes_are_refused() {
        let path = Path::new("p");
        let check_size = |width, height| Limits::default().check_size(path, width, height);
        assert!(check_size(1, 65535).is_ok() && check_size(8192, 8192).is_ok());
        for (width, height) in [(0, 1), (1, 0), (65536, 1), (1, 65536), (8193, 8192), (65535, 65535)] {
            let message = check_size(width, height).unwrap_err().to_string();
            assert!(message.contains(&format!("{width}x{height}")), "{message}");
        }
        let small = Limits { max_pixels: 15 };
        assert!(small.check_size(path, 5, 3).is_ok() && small.check_size(path, 4, 4).is_err());
    }
}
