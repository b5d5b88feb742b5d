//! The program as a server, and clients that say whatever they like.

use std::{
    io::{BufRead, BufReader, ErrorKind, Read, Write},
    net::TcpStream,
    process::{Child, Command, Stdio},
    time::Duration,
};

use multiscopic_tests::program;
use serde_json::Value;

/// The time within which a server must answer. Only a hung one reaches it.
const PATIENCE: Duration = Duration::from_secs(120);

/// A server that runs until it is dropped.
pub struct PageServer {
    child: Child,
    /// Its address and port.
    pub host: String,
    /// The path of the page: the token between slashes.
    pub path: String,
}

impl PageServer {
    /// Starts the program, and waits until it tells the address of its page.
    pub fn start(words: &[&str]) -> PageServer {
        let mut command = Command::new(program::binary());
        if cfg!(target_os = "linux") {
            command = Command::new("env");
            command.arg(program::DEFAULT_SIGNALS).arg(program::binary());
        }
        let mut child = command.args(words).arg("--no-open").stderr(Stdio::piped()).stdin(Stdio::null()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let address = lines.find_map(|line| Some(line.unwrap().split_once("open http://")?.1.to_owned())).expect("an address");
        std::thread::spawn(move || lines.for_each(drop));
        let (host, token) = address.split_once('/').unwrap();
        PageServer { child, host: host.into(), path: format!("/{token}") }
    }

    /// A connection that says nothing yet.
    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends a request as it is, and returns all of the answer. It is empty if the server breaks off.
    pub fn ask(&self, request: &[u8]) -> String {
        let mut stream = self.connect();
        let _ = stream.write_all(request);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// The status and the body of a page that is asked for with these headers.
    pub fn get(&self, path: &str, headers: &[(&str, &str)]) -> (u16, String) {
        let lines: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        let answer = self.ask(format!("GET {path} HTTP/1.1\r\n{lines}\r\n").as_bytes());
        let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_default();
        (status, answer)
    }

    /// The status of a socket that is asked for from a page of `origin`, with the connection.
    pub fn handshake(&self, path: &str, origin: Option<&str>) -> (u16, TcpStream) {
        let mut stream = self.connect();
        let origin = origin.map(|origin| format!("Origin: {origin}\r\n")).unwrap_or_default();
        let request = format!(
            "GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{origin}\r\n",
            self.host
        );
        let _ = stream.write_all(request.as_bytes());
        let mut head = Vec::new();
        let mut byte = [0];
        while !head.ends_with(b"\r\n\r\n") && stream.read(&mut byte).is_ok_and(|count| count > 0) {
            head.push(byte[0]);
        }
        let head = String::from_utf8_lossy(&head).into_owned();
        (head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_default(), stream)
    }

    /// A socket of a page that says that it is there, as browsers do.
    pub fn page(&self) -> PageSocket {
        let socket = self.socket();
        let mut other = PageSocket(socket.0.try_clone().unwrap());
        std::thread::spawn(move || {
            while other.send(10, b"") {
                std::thread::sleep(Duration::from_secs(2));
            }
        });
        socket
    }

    /// A socket that only says what the test says.
    pub fn socket(&self) -> PageSocket {
        let (status, stream) = self.handshake(&format!("{}socket", self.path), Some(&format!("http://{}", self.host)));
        assert_eq!(status, 101, "the socket is accepted");
        PageSocket(stream)
    }

    /// Sends a signal, and returns the exit code.
    #[cfg(unix)]
    pub fn end(mut self, signal: &str) -> Option<i32> {
        assert!(Command::new("kill").args([format!("-{signal}"), self.child.id().to_string()]).status().unwrap().success());
        self.child.wait().unwrap().code()
    }

    /// Whether it still runs.
    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }
}

impl Drop for PageServer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A socket of a page.
pub struct PageSocket(TcpStream);

impl PageSocket {
    /// Sends a frame with an operation code, masked as clients must.
    pub fn send(&mut self, code: u8, payload: &[u8]) -> bool {
        let mut frame = vec![0x80 | code];
        match payload.len() {
            length @ 0..126 => frame.push(0x80 | length as u8),
            length @ 126..65536 => {
                frame.push(0x80 | 126);
                frame.extend((length as u16).to_be_bytes());
            }
            length => {
                frame.push(0x80 | 127);
                frame.extend((length as u64).to_be_bytes());
            }
        }
        let mask = [7, 1, 9, 4];
        frame.extend(mask);
        frame.extend(payload.iter().zip(mask.iter().cycle()).map(|(byte, mask)| byte ^ mask));
        self.0.write_all(&frame).is_ok()
    }

    /// Sends bytes that are no frame.
    pub fn send_raw(&mut self, bytes: &[u8]) {
        let _ = self.0.write_all(bytes);
    }

    /// Asks for a match.
    pub fn ask(&mut self, settings: Value) {
        let wish = serde_json::json!({ "match": { "settings": settings, "core": "cortex-m4" } });
        assert!(self.send(1, wish.to_string().as_bytes()));
    }

    /// The operation code and the payload of the next frame. `None` once the server has closed the socket.
    pub fn receive(&mut self) -> Option<(u8, Vec<u8>)> {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).ok()?;
        let length = match head[1] & 0x7f {
            126 => u64::from(u16::from_be_bytes(self.bytes()?)),
            127 => u64::from_be_bytes(self.bytes()?),
            length => length.into(),
        };
        let mut payload = vec![0; length as usize];
        self.0.read_exact(&mut payload).ok()?;
        Some((head[0] & 0x0f, payload))
    }

    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }

    /// The next notice of a subject that `is_it`.
    pub fn notice(&mut self, subject: &str, is_it: impl Fn(&Value) -> bool) -> Value {
        loop {
            let (code, payload) = self.receive().unwrap_or_else(|| panic!("the socket ended before a notice of {subject}"));
            if code != 1 {
                continue;
            }
            let notice: Value = serde_json::from_slice(&payload).unwrap();
            if notice["subject"] == subject && is_it(&notice["contents"]) {
                return notice["contents"].clone();
            }
        }
    }

    /// Whether the server closes it without being asked to.
    pub fn is_closed_by_server(&mut self) -> bool {
        while let Some((code, _)) = self.receive() {
            if code == 8 {
                return true;
            }
        }
        // Nothing was read because the socket has ended, not because time has passed.
        let ended = self.0.read(&mut [0]).map_err(|error| error.kind());
        matches!(ended, Ok(0) | Err(ErrorKind::ConnectionReset | ErrorKind::BrokenPipe))
    }
}
