//! A camera of a network that sends JPEG pictures over HTTP: one after the other (`multipart/x-mixed-replace`, as mjpg-streamer, motion
//! and most network cameras do), or one for each request.

use std::{
    fmt,
    io::{self, Read, Write},
    net::{TcpStream, ToSocketAddrs},
    num::NonZeroU16,
    path::Path,
    str::FromStr,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use super::picture_mean::PictureMean;
use crate::{
    capture::{acquisition::BlockingCamera, sweep::Arrival},
    images::Picture,
};

/// Pictures of a stream that may have been exposed before the connection: servers send the latest one at once.
const PICTURES_IN_FLIGHT: u32 = 2;

/// The longest header in bytes.
const MAX_HEADER: usize = 1 << 14;

/// The longest picture in bytes.
const MAX_PICTURE: usize = 1 << 26;

/// The time for which a read blocks, after which cancellation is looked for.
const READ_TIMEOUT: Duration = Duration::from_millis(100);

/// The address of pictures: `http://HOST[:PORT][/PATH]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpUrl {
    text: String,
    host: String,
    path: String,
}

impl FromStr for HttpUrl {
    type Err = HttpError;

    fn from_str(text: &str) -> Result<HttpUrl, HttpError> {
        let wrong = |problem| HttpError { url: text.into(), fault: HttpFault::Url(problem) };
        let rest = text.strip_prefix("http://").ok_or_else(|| wrong("it does not begin with http://"))?;
        let at = rest.find(['/', '?']).unwrap_or(rest.len());
        let (host, path) = rest.split_at(at);
        if text.contains(|c: char| c.is_whitespace() || c.is_control()) {
            return Err(wrong("it has blanks"));
        }
        if host.contains('@') {
            return Err(wrong("names and passwords are not sent: read it with GStreamer, by exec: and camera_gstreamer.sh"));
        }
        if host.is_empty() || host.starts_with(':') {
            return Err(wrong("the host is missing"));
        }
        let has_port =
            host.rsplit_once(':').is_some_and(|(_, port)| !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()));
        let host = if has_port { host.to_owned() } else { format!("{host}:80") };
        let path = if path.starts_with('/') { path.to_owned() } else { format!("/{path}") };
        Ok(HttpUrl { text: text.into(), host, path })
    }
}

impl fmt::Display for HttpUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// An error of a camera of a network. Its message names the address.
#[derive(Debug, thiserror::Error)]
#[error("{url}: {fault}")]
pub struct HttpError {
    /// The address.
    pub url: String,
    /// The fault.
    pub fault: HttpFault,
}

impl From<HttpError> for crate::error::Error {
    fn from(error: HttpError) -> crate::error::Error {
        crate::error::Error::Device(Box::new(error))
    }
}

/// A fault of a camera of a network, with the expectation and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HttpFault {
    /// It is not an address.
    #[error("{0}; expected http://HOST[:PORT][/PATH]")]
    Url(&'static str),
    /// The server cannot be reached.
    #[error("cannot connect: {0}; check the address, the camera's power and the network")]
    Connect(#[source] io::Error),
    /// The connection broke.
    #[error("the connection broke: {0}; try again, and check the network if it persists")]
    Broken(#[source] io::Error),
    /// The server refuses.
    #[error("found the answer `{0}`, expected pictures: check the path, and that no password is asked for")]
    Status(String),
    /// The answer has no pictures.
    #[error("found {0}, expected JPEG pictures (image/jpeg, or a stream multipart/x-mixed-replace of them)")]
    NotPictures(String),
    /// No picture came in time.
    #[error("found {pictures} of {expected} pictures after {:.1} s; check the network, or allow more time", waited.as_secs_f32())]
    NoPicture {
        /// Pictures that came.
        pictures: u32,
        /// Pictures that were needed, with those that are dropped.
        expected: u32,
        /// The time for which they were waited for.
        waited: Duration,
    },
    /// A picture has another size than the first.
    #[error("found a picture of {found:?} pixels, expected {expected:?} as the first")]
    Size {
        /// Its width and height.
        found: (u32, u32),
        /// The width and height of the first.
        expected: (u32, u32),
    },
    /// It was cancelled.
    #[error("cancelled")]
    Cancelled,
}

/// A camera of a network.
///
/// It connects for each picture. Of a stream, it drops the first two pictures, which may have been exposed before: let the stage
/// settle for as long as the camera's pictures come late. While it runs free, it takes all pictures of one stream.
pub struct HttpCamera {
    url: HttpUrl,
    average: NonZeroU16,
    /// Width and height of the first picture in pixels.
    size: Option<(u32, u32)>,
    /// The stream, while it runs free.
    stream: Option<Answer>,
}

impl HttpCamera {
    /// The camera at an address. Its pictures are the rounded means of `average` pictures. Nothing is sent yet.
    pub fn new(url: HttpUrl, average: NonZeroU16) -> HttpCamera {
        HttpCamera { url, average, size: None, stream: None }
    }

    /// Takes a picture, in colour if it has colours. It returns within `timeout`, and within a tenth of a second once
    /// `is_cancelled` is set, but for the time that the system takes to look up the host.
    ///
    /// # Errors
    /// The server cannot be reached, refuses, or sends no picture of the size of the first in time.
    pub fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, HttpError> {
        self.stream = None;
        let (start, wait) = (Instant::now(), Wait { deadline: Instant::now() + timeout, is_cancelled });
        let taken = self.try_take(start, wait);
        taken.map_err(|fault| self.error(fault))
    }

    /// Takes the next picture of a stream, of which none is dropped, or one of a server that sends one for each request.
    fn next_of_stream(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Arrival, HttpError> {
        let wait = Wait { deadline: Instant::now() + timeout, is_cancelled };
        let running = self.stream.take().map_or_else(|| Answer::get(&self.url, wait), Ok);
        let mut answer = running.map_err(|fault| self.error(fault))?;
        let is_stream = answer.boundary.is_some();
        let bytes = if is_stream { answer.next_part(wait) } else { answer.whole(wait) };
        let bytes = bytes.map_err(|fault| self.error(fault))?;
        let at = Instant::now();
        let picture = self.decode(&bytes).map_err(|fault| self.error(fault))?;
        self.stream = is_stream.then_some(answer);
        Ok(Arrival { picture, at })
    }

    fn error(&self, fault: HttpFault) -> HttpError {
        HttpError { url: self.url.text.clone(), fault }
    }

    fn try_take(&mut self, start: Instant, wait: Wait<'_>) -> Result<Picture, HttpFault> {
        let average = u32::from(self.average.get());
        let (mut pictures, mut expected, mut mean) = (0, average, PictureMean::default());
        let url = self.url.clone();
        let mut take = || {
            while pictures < expected {
                let mut answer = Answer::get(&url, wait)?;
                if answer.boundary.is_none() {
                    mean.add(self.decode(&answer.whole(wait)?)?);
                    pictures += 1;
                    continue;
                }
                expected = PICTURES_IN_FLIGHT + average;
                while pictures < expected {
                    let bytes = answer.next_part(wait)?;
                    pictures += 1;
                    if pictures > PICTURES_IN_FLIGHT {
                        mean.add(self.decode(&bytes)?);
                    }
                }
            }
            Ok(())
        };
        take().map_err(|fault| match fault {
            HttpFault::NoPicture { .. } => HttpFault::NoPicture { pictures, expected, waited: start.elapsed() },
            fault => fault,
        })?;
        Ok(mean.picture().expect("at least one picture"))
    }

    /// Decodes a picture, which must have the size of the first.
    fn decode(&mut self, bytes: &[u8]) -> Result<Picture, HttpFault> {
        let picture = Picture::decode(Path::new("a picture"), bytes);
        let picture = picture.map_err(|error| HttpFault::NotPictures(error.to_string()))?;
        let (found, expected) = (picture.dimensions(), *self.size.get_or_insert(picture.dimensions()));
        if found == expected { Ok(picture) } else { Err(HttpFault::Size { found, expected }) }
    }
}

impl BlockingCamera for HttpCamera {
    type Error = HttpError;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, HttpError> {
        HttpCamera::take(self, timeout, is_cancelled)
    }

    fn next(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Arrival, HttpError> {
        self.next_of_stream(timeout, is_cancelled)
    }
}

/// One line: `http://camera.local/stream, 640x480`.
impl fmt::Display for HttpCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.url)?;
        self.size.map_or(Ok(()), |(width, height)| write!(f, ", {width}x{height}"))
    }
}

/// The wait for pictures.
#[derive(Clone, Copy)]
struct Wait<'a> {
    deadline: Instant,
    /// Set to end it early.
    is_cancelled: &'a AtomicBool,
}

/// The answer to a request, as far as it has come.
struct Answer {
    stream: TcpStream,
    /// Bytes that have come and are not used.
    bytes: Vec<u8>,
    /// The line between the parts of a stream, with its dashes.
    boundary: Option<Vec<u8>>,
    /// The length of a single picture, if it is told.
    length: Option<usize>,
}

impl Answer {
    /// Asks for pictures.
    fn get(url: &HttpUrl, wait: Wait<'_>) -> Result<Answer, HttpFault> {
        let addresses = url.host.to_socket_addrs().map_err(HttpFault::Connect)?;
        let mut last_error = io::ErrorKind::AddrNotAvailable.into();
        let connected = addresses.into_iter().find_map(|address| {
            let remaining = wait.deadline.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
            TcpStream::connect_timeout(&address, remaining).map_err(|error| last_error = error).ok()
        });
        let mut stream = connected.ok_or(HttpFault::Connect(last_error))?;
        // Of HTTP 1.0, since its answers come in one piece.
        let request =
            format!("GET {} HTTP/1.0\r\nHost: {}\r\nUser-Agent: multiscopic\r\nAccept: */*\r\n\r\n", url.path, url.host);
        stream
            .set_read_timeout(Some(READ_TIMEOUT))
            .and_then(|()| stream.write_all(request.as_bytes()))
            .map_err(HttpFault::Broken)?;
        let mut answer = Answer { stream, bytes: Vec::new(), boundary: None, length: None };
        let header = answer.header(wait)?;
        let status = header.lines().next().unwrap_or_default();
        if status.split(' ').nth(1) != Some("200") {
            return Err(HttpFault::Status(status.chars().filter(|c| !c.is_control()).take(80).collect()));
        }
        let kind = field(&header, "content-type").unwrap_or_default();
        answer.length = field(&header, "content-length").and_then(|length| length.parse().ok());
        match kind.to_ascii_lowercase() {
            lower if lower.starts_with("multipart/") => {
                let at = lower.find("boundary=").map(|at| at + "boundary=".len());
                let name = at.and_then(|at| kind.get(at..)?.split(';').next()).map(|name| name.trim().trim_matches('"'));
                let name = name
                    .filter(|name| !name.is_empty())
                    .ok_or_else(|| HttpFault::NotPictures("a stream without a boundary".into()))?;
                // Some servers count the dashes as part of its name.
                answer.boundary = Some(format!("--{}", name.trim_start_matches("--")).into_bytes());
            }
            lower if lower.starts_with("image/") => {}
            lower => return Err(HttpFault::NotPictures(format!("the type `{lower:.60}`"))),
        }
        Ok(answer)
    }

    /// Waits for more bytes. Returns false at the end.
    fn more(&mut self, wait: Wait<'_>) -> Result<bool, HttpFault> {
        let mut piece = [0; 1 << 14];
        loop {
            if wait.is_cancelled.load(Ordering::Relaxed) {
                return Err(HttpFault::Cancelled);
            }
            if Instant::now() >= wait.deadline {
                return Err(HttpFault::NoPicture { pictures: 0, expected: 1, waited: Duration::ZERO });
            }
            match self.stream.read(&mut piece) {
                Ok(count) => {
                    self.bytes.extend_from_slice(&piece[..count]);
                    return Ok(count > 0);
                }
                Err(error)
                    if [io::ErrorKind::WouldBlock, io::ErrorKind::TimedOut, io::ErrorKind::Interrupted]
                        .contains(&error.kind()) => {}
                Err(error) => return Err(HttpFault::Broken(error)),
            }
        }
    }

    /// Waits for more bytes, which must come.
    fn need(&mut self, wait: Wait<'_>) -> Result<(), HttpFault> {
        if self.more(wait)? { Ok(()) } else { Err(HttpFault::Broken(io::ErrorKind::UnexpectedEof.into())) }
    }

    /// The place of a sequence of bytes, which must come before `limit` bytes have.
    fn find(&mut self, sequence: &[u8], limit: usize, wait: Wait<'_>) -> Result<usize, HttpFault> {
        let mut searched: usize = 0;
        loop {
            let start = searched.saturating_sub(sequence.len());
            if let Some(at) = self.bytes[start..].windows(sequence.len()).position(|window| window == sequence) {
                return Ok(start + at);
            }
            if self.bytes.len() > limit {
                return Err(HttpFault::NotPictures(format!("{} bytes without an end", self.bytes.len())));
            }
            searched = self.bytes.len();
            self.need(wait)?;
        }
    }

    /// The lines up to the next empty one.
    fn header(&mut self, wait: Wait<'_>) -> Result<String, HttpFault> {
        let end = self.find(b"\r\n\r\n", MAX_HEADER, wait)?;
        let header = self.bytes.drain(..end + 4).collect::<Vec<_>>();
        Ok(String::from_utf8_lossy(&header).into_owned())
    }

    /// So many bytes.
    fn exactly(&mut self, count: usize, wait: Wait<'_>) -> Result<Vec<u8>, HttpFault> {
        if count > MAX_PICTURE {
            return Err(HttpFault::NotPictures(format!("a picture of {count} bytes")));
        }
        while self.bytes.len() < count {
            self.need(wait)?;
        }
        Ok(self.bytes.drain(..count).collect())
    }

    /// The single picture of an answer.
    fn whole(&mut self, wait: Wait<'_>) -> Result<Vec<u8>, HttpFault> {
        if let Some(length) = self.length {
            return self.exactly(length, wait);
        }
        while self.more(wait)? {
            if self.bytes.len() > MAX_PICTURE {
                return Err(HttpFault::NotPictures(format!("{} bytes without an end", self.bytes.len())));
            }
        }
        Ok(std::mem::take(&mut self.bytes))
    }

    /// The next picture of a stream.
    fn next_part(&mut self, wait: Wait<'_>) -> Result<Vec<u8>, HttpFault> {
        let boundary = self.boundary.clone().unwrap_or_default();
        let at = self.find(&boundary, MAX_HEADER, wait)?;
        self.bytes.drain(..at + boundary.len());
        let header = self.header(wait)?;
        match field(&header, "content-length").and_then(|length| length.parse().ok()) {
            Some(length) => self.exactly(length, wait),
            // The picture ends before the next boundary, which stays.
            None => {
                let end = self.find(&boundary, MAX_PICTURE, wait)?;
                Ok(self.bytes.drain(..end).collect())
            }
        }
    }
}

/// The value of a field in the lines of a header.
fn field(header: &str, name: &str) -> Option<String> {
    let fields = header.lines().filter_map(|line| line.split_once(':'));
    fields.into_iter().find(|(found, _)| found.trim().eq_ignore_ascii_case(name)).map(|(_, value)| value.trim().to_owned())
}
