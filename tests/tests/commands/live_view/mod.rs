//! `tune`: the clients of its server, hostile ones among them, its answers, and the code that its page gives. `tuned` has the
//! code for some settings, compiled and run.

#![cfg(unix)]

mod hostile_clients;
#[rustfmt::skip]
mod tuned;

use std::{
    env, fs,
    io::{BufRead, BufReader, ErrorKind, Read, Write},
    net::TcpStream,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use multiscopic::{DisparityMap, Frames, Result, Rig};
use multiscopic_tests::program::{self, Invocation, make};
use serde_json::{Value, json};

/// A rig of a made-up scene.
fn rig(folder: &Path) -> String {
    rig_of(folder, "160x120")
}

fn rig_of(folder: &Path, size: &str) -> String {
    let scenes = folder.join("rig");
    make(&format!("scene --random --seed 3 --size {size} --views 4"), &scenes);
    scenes.join("0000").to_str().unwrap().to_owned()
}

#[test]
fn signals_end_the_server_with_their_codes() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig(dir.path());
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let server = PageServer::start(&["tune", &rig]);
        let mut socket = server.socket();
        socket.notice("result", |_| true);
        assert_eq!(server.end(signal), Some(code));
        assert!(socket.is_closed_by_server());
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_new_rig_is_shown_by_blocks_at_once_and_then_by_the_method_of_match() {
    let dir = tempfile::tempdir().unwrap();
    // So large that the network is not done before the socket is there, which would then see its notice alone.
    let server = PageServer::start(&["tune", &rig_of(dir.path(), "640x480")]);
    let mut socket = server.page();
    let mut first = || socket.notice("result", |_| true);
    let [at_once, then] = [first(), first()];
    assert!(at_once["summary"].as_str().unwrap().starts_with("bm, "), "{at_once:.200}");
    assert!(then["summary"].as_str().unwrap().starts_with("net, "), "{then:.200}");
    assert_eq!([&at_once["settings"], &then["settings"]], [&json!({ "method": "net" }); 2]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_slow_match_is_given_up_for_the_next_one() {
    let dir = tempfile::tempdir().unwrap();
    let server = PageServer::start(&["tune", &rig(dir.path())]);
    let mut socket = server.socket();
    socket.notice("result", |_| true);
    let slow = json!({ "method": "gc", "num-disparities": "120", "min-disparity": "-60" });
    socket.ask(slow.clone());
    socket.notice("plan", |contents| contents["settings"] == slow);
    socket.notice("progress", |_| true);
    let quick = json!({ "method": "bm", "num-disparities": "20" });
    socket.ask(quick.clone());
    let result = socket.notice("result", |contents| contents["settings"]["method"] != "net");
    assert_eq!(result["settings"], quick, "the graph cuts were given up");
}

#[test]
fn wrong_rigs_and_addresses_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().to_str().unwrap();
    Invocation::new(["tune", empty]).assert_refused(&["rig.toml"]);
    Invocation::new(["live"]).assert_refused(&["--camera", "RIG_DIR"]);
    Invocation::new(["live", empty, "--camera", "sim"]).assert_refused(&["cannot be used with"]);
    let rig = rig(dir.path());
    Invocation::new(["live", &rig, "--listen", "192.0.2.1:80"]).assert_refused(&["cannot listen on 192.0.2.1:80"]);
}

/// The code in a module of `tuned`.
fn code_of(module: &str) -> &'static str {
    let (_, rest) = include_str!("tuned.rs").split_once(&format!("pub mod {module} {{\n")).expect("a module");
    &rest[..rest.find("\n}\n}\n").expect("the end of a module") + "\n}\n".len()]
}

/// Settings, the module with the code that is expected for them, and this code compiled.
type Case = (Value, &'static str, fn(&Frames) -> Result<DisparityMap>);

fn cases() -> [Case; 4] {
    [
        (
            json!({
                "method": "bm", "fusion": "mean", "min-disparity": "-2", "num-disparities": "40", "block-size": "9",
                "uniqueness-ratio": "5", "disp12-max-diff": "2", "texture-threshold": "100", "median": "5",
                "speckle-window-size": "30", "speckle-range": "2", "sub-pixel": "lucas-kanade", "min-confidence": "0.3",
            }),
            "blocks",
            tuned::blocks::disparities,
        ),
        (
            json!({ "method": "sgm", "num-disparities": "40", "cost": "census2", "census": "7x7", "p1": "5", "p2": "30",
                "p2-edge": "12", "paths": "8", "smooth": "" }),
            "paths",
            tuned::paths::disparities,
        ),
        (
            json!({ "method": "gc", "num-disparities": "16", "occlusion-cost": "12", "lambda1": "4",
                "smoothness": "potts", "sweeps": "2" }),
            "cuts",
            tuned::cuts::disparities,
        ),
        (json!({ "method": "net", "num-disparities": "40", "fill": "background" }), "network", tuned::network::disparities),
    ]
}

/// With `MULTISCOPIC_BLESS` set, `tuned` is written anew.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn the_code_on_the_page_computes_what_the_command_computes() {
    let dir = tempfile::tempdir().unwrap();
    // Small, since it is matched for each of the settings.
    let folder = rig_of(dir.path(), "80x60");
    let rig = Rig::load(Path::new(&folder)).unwrap();
    let (frames, _) = Frames::load(&rig.images.within(Path::new(&folder))).unwrap();
    let server = PageServer::start(&["tune", &folder]);
    let mut socket = server.page();
    for (settings, module, disparities) in cases() {
        let code = code_of(module);
        socket.ask(settings.clone());
        let plan = socket.notice("plan", |contents| contents["settings"] == settings);
        let given = plan["rust"].as_str().unwrap();
        if env::var_os("MULTISCOPIC_BLESS").is_some() {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/commands/live_view/tuned.rs");
            let tuned = fs::read_to_string(&path).unwrap();
            fs::write(&path, tuned.replace(code, given)).unwrap();
            continue;
        }
        assert_eq!(given, code, "{settings}");
        let output = dir.path().join("disparity.pfm");
        let command = plan["command"].as_str().unwrap();
        let words = command.split(' ').skip(1).map(|word| if word == "disparity.pfm" { output.to_str().unwrap() } else { word });
        Invocation::new(words).assert_done();
        let expected = DisparityMap::from_float(&multiscopic::files::read_pfm(&output).unwrap());
        assert!(disparities(&frames).unwrap() == expected, "{command}");
    }
}

/// The time after which a server counts as hung.
const PATIENCE: Duration = Duration::from_secs(180);

/// Waits until something happens. Panics if it never does.
#[track_caller]
fn wait_until(what: &str, mut happens: impl FnMut() -> bool) {
    let start = Instant::now();
    while !happens() {
        assert!(start.elapsed() < PATIENCE, "{what}: nothing happens");
        thread::sleep(Duration::from_millis(20));
    }
}

/// A server that runs until it is dropped.
struct PageServer {
    child: Child,
    /// Its address and port.
    pub host: String,
    /// The path of the page: the token between slashes.
    pub path: String,
}

impl PageServer {
    /// Starts the program, and waits until it tells the address of its page.
    fn start(words: &[&str]) -> PageServer {
        let mut command = Command::new(program::binary());
        if cfg!(target_os = "linux") {
            command = Command::new("env");
            command.arg(program::DEFAULT_SIGNALS).arg(program::binary());
        }
        let mut child = command.args(words).arg("--no-open").stderr(Stdio::piped()).stdin(Stdio::null()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let address = lines.find_map(|line| Some(line.unwrap().split_once("open http://")?.1.to_owned())).expect("an address");
        thread::spawn(move || lines.for_each(drop));
        let (host, token) = address.split_once('/').unwrap();
        PageServer { child, host: host.into(), path: format!("/{token}") }
    }

    /// A connection that says nothing yet.
    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends a request as it is, and returns all of the answer. It is empty if the server breaks off.
    fn ask(&self, request: &[u8]) -> String {
        let mut stream = self.connect();
        let _ = stream.write_all(request);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// The status and the body of a page that is asked for with these headers.
    fn get(&self, path: &str, headers: &[(&str, &str)]) -> (u16, String) {
        let lines: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        let answer = self.ask(format!("GET {path} HTTP/1.1\r\n{lines}\r\n").as_bytes());
        let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_default();
        (status, answer)
    }

    /// The status of a socket that is asked for from a page of `origin`, with the connection.
    fn handshake(&self, path: &str, origin: Option<&str>) -> (u16, TcpStream) {
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
    fn page(&self) -> PageSocket {
        let socket = self.socket();
        let mut other = PageSocket(socket.0.try_clone().unwrap());
        thread::spawn(move || {
            while other.send(10, b"") {
                thread::sleep(Duration::from_secs(2));
            }
        });
        socket
    }

    /// A socket that only says what the test says.
    fn socket(&self) -> PageSocket {
        let (status, stream) = self.handshake(&format!("{}socket", self.path), Some(&format!("http://{}", self.host)));
        assert_eq!(status, 101, "the socket is accepted");
        PageSocket(stream)
    }

    /// Sends a signal, and returns the exit code.
    #[cfg(unix)]
    fn end(mut self, signal: &str) -> Option<i32> {
        assert!(Command::new("kill").args([format!("-{signal}"), self.child.id().to_string()]).status().unwrap().success());
        self.child.wait().unwrap().code()
    }

    /// True if it still runs.
    fn is_running(&mut self) -> bool {
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
struct PageSocket(TcpStream);

impl PageSocket {
    /// Sends a frame with an operation code, masked as clients must.
    fn send(&mut self, code: u8, payload: &[u8]) -> bool {
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
    fn send_raw(&mut self, bytes: &[u8]) {
        let _ = self.0.write_all(bytes);
    }

    /// Asks for a match.
    fn ask(&mut self, settings: Value) {
        let wish = serde_json::json!({ "match": { "settings": settings, "core": "cortex-m4" } });
        assert!(self.send(1, wish.to_string().as_bytes()));
    }

    /// The operation code and the payload of the next frame. `None` once the server has closed the socket.
    fn receive(&mut self) -> Option<(u8, Vec<u8>)> {
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
    fn notice(&mut self, subject: &str, is_it: impl Fn(&Value) -> bool) -> Value {
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

    /// True if the server closes it without being asked to.
    fn is_closed_by_server(&mut self) -> bool {
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
