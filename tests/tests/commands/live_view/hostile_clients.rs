//! Clients that are not the page.

use std::io::Write;

use multiscopic_reference::split_mix::Random;
use multiscopic_tests::program::Invocation;
use serde_json::{Value, json};

use super::{PageServer, rig, wait_until};

#[test]
fn only_the_page_is_answered() {
    let dir = tempfile::tempdir().unwrap();
    let server = PageServer::start(&["tune", &rig(dir.path())]);
    let (host, page) = (server.host.clone(), server.path.clone());
    let own = format!("http://{host}");
    let (status, answer) = server.get(&page, &[("Host", &host)]);
    assert_eq!(status, 200);
    for header in ["cache-control: no-store", "referrer-policy: no-referrer", "frame-ancestors 'none'", "connect-src 'self'"] {
        assert!(answer.to_lowercase().contains(header), "{header}");
    }
    assert!(!answer.contains("http://") && !answer.contains("https://"), "the page names no other server");

    // Other tokens, hosts, origins and methods.
    let other_token = format!("/{}/", "0".repeat(page.len() - 2));
    let almost = format!("{}{}/", &page[..page.len() - 2], if page.ends_with("0/") { '1' } else { '0' });
    let port = host.split_once(':').unwrap().1;
    for (path, headers) in [
        (other_token.as_str(), &[("Host", host.as_str())][..]),
        (&almost, &[("Host", &host)]),
        (&page, &[("Host", &format!("evil.example:{port}"))]),
        (&page, &[("Host", "127.0.0.1")]),
        (&page, &[("Host", &host), ("Host", &host)]),
        (&page, &[("Host", &host), ("Origin", "http://evil.example")]),
        (&page, &[("Host", &host), ("Origin", "null")]),
    ] {
        let (status, answer) = server.get(path, headers);
        assert!([400, 403].contains(&status), "{path} {headers:?}: {answer}");
        assert!(!answer.contains("<html"), "{path} {headers:?}");
    }
    // Nothing but the page has an address.
    for path in ["/", "/rig.toml", "/../rig.toml", "/etc/passwd", &format!("{page}rig.toml"), &format!("{page}..%2Frig.toml")] {
        let (status, answer) = server.get(path, &[("Host", &host)]);
        assert!((400..500).contains(&status), "{path}: {answer}");
    }
    let posted = server.ask(format!("POST {page} HTTP/1.1\r\nHost: {host}\r\nContent-Length: 0\r\n\r\n").as_bytes());
    assert!(posted.contains(" 405 "), "{posted}");

    let socket = format!("{page}socket");
    assert_eq!(server.handshake(&socket, Some(&own)).0, 101);
    for origin in [None, Some("null"), Some("http://evil.example"), Some("http://localhost:1")] {
        assert_eq!(server.handshake(&socket, origin).0, 403, "{origin:?}");
    }
    assert_eq!(server.handshake(&format!("{other_token}socket"), Some(&own)).0, 403);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn broken_requests_and_messages_end_their_connection_alone() {
    let dir = tempfile::tempdir().unwrap();
    let mut server = PageServer::start(&["tune", &rig(dir.path())]);
    let mut page = server.page();
    page.notice("result", |_| true);

    // Requests that are none, or too long.
    let mut random = Random(5);
    for length in [1, 100, 3000] {
        let noise: Vec<u8> = (0..length).map(|_| random.byte()).chain(*b"\r\n\r\n").collect();
        assert!(!server.ask(&noise).contains(" 200 "));
    }
    let long = format!("GET {} HTTP/1.1\r\nHost: {}\r\nX: {}\r\n\r\n", server.path, server.host, "x".repeat(1 << 20));
    assert!(!server.ask(long.as_bytes()).contains(" 200 "));
    let many = format!("GET {} HTTP/1.1\r\nHost: {}\r\n{}\r\n", server.path, server.host, "a: b\r\n".repeat(5000));
    assert!(!server.ask(many.as_bytes()).contains(" 200 "));

    // Messages that make no sense, or are too large.
    let long = json!({ "match": { "settings": { "method": "x".repeat(8 << 10) }, "core": "cortex-m4" } }).to_string();
    let nested = "[".repeat(4000);
    let texts: [&[u8]; 9] = [
        b"",
        b"hello",
        b"{}",
        br#"{"match":{}}"#,
        br#"{"match":{"settings":{"method":1},"core":"cortex-m4"}}"#,
        br#"{"match":{"settings":{},"core":"cortex-m4","output":"/tmp/x"}}"#,
        br#""take""#,
        long.as_bytes(),
        nested.as_bytes(),
    ];
    for text in texts {
        let mut socket = server.socket();
        socket.send(1, text);
        assert!(socket.is_closed_by_server(), "{}", String::from_utf8_lossy(&text[..text.len().min(60)]));
    }
    for (code, payload) in [(2, &b"binary"[..]), (1, b"\xff\xfe"), (3, b""), (1, &[b'x'; 70_000])] {
        let mut socket = server.socket();
        socket.send(code, payload);
        assert!(socket.is_closed_by_server(), "operation {code}");
    }
    // Frames without a mask, with a length that never comes, and noise. The server waits a while for the rest of a message.
    let broken = [&b"\x81\x05hello"[..], b"\x81\xff\xff\xff\xff\xff\xff\xff\xff\xff", b"\xff\xff\xff\xff", b"\x81\x85\0\0\0\0he"];
    let sockets = broken.map(|bytes| {
        let mut socket = server.socket();
        socket.send_raw(bytes);
        (bytes, socket)
    });
    for (bytes, mut socket) in sockets {
        assert!(socket.is_closed_by_server(), "{bytes:?}");
    }

    // A well-formed request for something that the page does not offer is refused by a notice.
    for settings in [
        json!({ "method": "bm", "output": "/tmp/x" }),
        json!({ "method": "--help" }),
        json!({ "method": "bm", "num-disparities": "60000" }),
        json!({ "method": "bm", "block-size": "4" }),
        json!({ "fusion": "../x" }),
    ] {
        page.ask(settings.clone());
        let result = page.notice("result", |contents| contents["settings"] == settings);
        assert!(result["failure"].is_string(), "{settings}: {result}");
    }
    let settings = json!({ "method": "bm", "num-disparities": "17" });
    page.ask(settings.clone());
    assert!(page.notice("result", |contents| contents["settings"] == settings)["map"].is_object());
    assert!(server.is_running());
}

/// Options of the page, with values that some of them take.
const SETTINGS: [(&str, &[&str]); 26] = [
    ("method", &["bm", "sgm", "gc", "net", "mccnn-fast"]),
    ("fusion", &["min", "mean", "heuristic", "half"]),
    ("min-disparity", &["-128", "0", "255"]),
    ("num-disparities", &["2", "17", "256"]),
    ("block-size", &["1", "3", "21"]),
    ("cost", &["census", "census2", "sad"]),
    ("census", &["9x7", "7x7", "5x5"]),
    ("p1", &["0", "51"]),
    ("p2", &["0", "51"]),
    ("p2-edge", &["1", "255"]),
    ("paths", &["4", "5", "8"]),
    ("occlusion-cost", &["1", "60"]),
    ("lambda1", &["0.5", "40"]),
    ("smoothness", &["linear", "potts"]),
    ("sweeps", &["1"]),
    ("uniqueness-ratio", &["0", "60"]),
    ("disp12-max-diff", &["0", "16"]),
    ("texture-threshold", &["0", "4000"]),
    ("median", &["3", "31"]),
    ("speckle-window-size", &["10", "3000"]),
    ("speckle-range", &["0", "16"]),
    ("sub-pixel", &["default", "lucas-kanade", "none"]),
    ("repair", &["default", "smooth", "none"]),
    ("hidden", &["default", "background", "none"]),
    ("min-confidence", &["0", "1"]),
    ("smooth", &["", "x"]),
];

/// Values that few options take.
const ODD_VALUES: [&str; 9] = ["", "-1", "1e9", "nan", "65536", "99999999999999999999", "0.5", "--help", "\u{0}"];

/// Any of the settings, in any combination, with values of their own, of others, or odd ones.
fn random_settings(random: &mut Random) -> Value {
    let count = 1 + random.below(6);
    let settings = (0..count).map(|_| {
        let (name, values) = SETTINGS[random.below(SETTINGS.len())];
        let (_, others) = SETTINGS[random.below(SETTINGS.len())];
        let values = match random.below(8) {
            0 => &ODD_VALUES[..],
            1 => others,
            _ => values,
        };
        (name.to_owned(), values[random.below(values.len())].into())
    });
    Value::Object(settings.collect())
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn whatever_is_asked_for_is_matched_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let small = dir.path().join("small").display().to_string();
    let size = ["scene", "--random", "--seed", "3", "--size", "48x36", "--views", "4", "-o", &small];
    Invocation::new(size).assert_done();
    let mut server = PageServer::start(&["tune", &format!("{small}/0000")]);
    let mut page = server.page();
    page.notice("result", |_| true);

    let mut random = Random(21);
    let (mut matched, mut refused) = (0, 0);
    for _ in 0..150 {
        let settings = random_settings(&mut random);
        page.ask(settings.clone());
        let result = page.notice("result", |contents| contents["settings"] == settings);
        match (result["map"].is_object(), result["failure"].is_string()) {
            (true, false) => matched += 1,
            (false, true) => refused += 1,
            _ => panic!("{settings}: {result}"),
        }
    }
    assert!(matched > 30 && refused > 30, "{matched} matched, {refused} refused");

    // Messages that were damaged on their way. The server takes them, or ends their connection.
    for _ in 0..150 {
        let wish = json!({ "match": { "settings": random_settings(&mut random), "core": "cortex-m4" } });
        let mut text = wish.to_string().into_bytes();
        for _ in 0..1 + random.below(3) {
            let at = random.below(text.len());
            match random.below(3) {
                0 => text[at] = random.byte(),
                1 => drop(text.drain(at..)),
                _ => text.insert(at, b"{}[]\",:\\0"[random.below(9)]),
            }
            if text.is_empty() {
                break;
            }
        }
        server.socket().send(1, &text);
    }
    let settings = json!({ "method": "bm", "num-disparities": "17" });
    page.ask(settings.clone());
    assert!(page.notice("result", |contents| contents["settings"] == settings)["map"].is_object());
    assert!(server.is_running());
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_thousand_sockets_do_not_stop_the_page() {
    let dir = tempfile::tempdir().unwrap();
    let mut server = PageServer::start(&["tune", &rig(dir.path())]);
    let mut page = server.page();
    page.notice("result", |_| true);

    // Connections that say nothing, or begin a request and never end it.
    let mut silent: Vec<_> = (0..1000).map(|_| server.connect()).collect();
    for stream in silent.iter_mut().step_by(2) {
        let _ = stream.write_all(b"GET / HTTP/1.1\r\nHost: ");
    }
    let settings = json!({ "method": "bm", "num-disparities": "19" });
    page.ask(settings.clone());
    assert!(page.notice("result", |contents| contents["settings"] == settings)["map"].is_object(), "the page goes on");
    // Once their time is over, others are served, though nobody has closed them.
    wait_until("silent connections", || server.get(&server.path, &[("Host", &server.host)]).0 == 200);
    drop(silent);

    // Sockets of pages, with the token.
    let (path, own) = (format!("{}socket", server.path), format!("http://{}", server.host));
    let sockets: Vec<_> = (0..1000).map(|_| server.handshake(&path, Some(&own))).collect();
    let accepted = sockets.iter().filter(|(status, _)| *status == 101).count();
    assert!((10..=16).contains(&accepted), "{accepted} sockets are open");
    assert!(sockets.iter().all(|(status, _)| [0, 101, 503].contains(status)));
    let settings = json!({ "method": "bm", "num-disparities": "21" });
    page.ask(settings.clone());
    assert!(page.notice("result", |contents| contents["settings"] == settings)["map"].is_object(), "the page goes on");
    drop(sockets);
    wait_until("closed sockets are replaced", || server.handshake(&path, Some(&own)).0 == 101);
    assert!(server.is_running());
}
