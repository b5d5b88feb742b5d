//! The server of the page: who may talk to it, and how much.

use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
    time::Duration,
};

use axum::{
    Router,
    extract::{
        DefaultBodyLimit, Path, Request, State, WebSocketUpgrade,
        ws::{CloseFrame, Message, WebSocket, close_code, rejection::WebSocketUpgradeRejection},
    },
    http::{
        HeaderMap, HeaderName, HeaderValue, StatusCode,
        header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, ORIGIN, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS},
    },
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};
use multiscopic::{Error, Result};
use tokio::{
    net::TcpListener,
    sync::Semaphore,
    time::{Instant, interval, timeout},
};

use super::notice_board::NoticeBoard;
use crate::command::connections;

/// The most pages that are connected at once.
const MOST_SOCKETS: usize = 16;
/// The header that forbids pages to show the server's page inside themselves.
const NO_FRAMES: &str = "frame-ancestors 'none'";

/// A server that listens, and serves nothing yet.
pub struct Server {
    listener: TcpListener,
    gate: Gate,
}

/// The state that all requests share.
struct Shared {
    gate: Gate,
    page: String,
    sockets: Arc<Semaphore>,
    messages: Arc<dyn Messages>,
}

impl Server {
    /// Listens on an address.
    pub async fn bind(address: SocketAddr) -> Result<Server> {
        let refused =
            |error: std::io::Error| Error::Usage(format!("cannot listen on {address}: {error}; --listen gives another address"));
        let listener = TcpListener::bind(address).await.map_err(refused)?;
        let gate = Gate::new(listener.local_addr().map_err(refused)?)?;
        Ok(Server { listener, gate })
    }

    /// The address of the page, with the token.
    pub fn address(&self) -> String {
        self.gate.address()
    }

    /// Serves the page and its messages until `end` is complete.
    pub async fn run(self, page: String, messages: Arc<dyn Messages>, end: impl Future<Output = ()>) {
        let Server { listener, gate } = self;
        let shared = Arc::new(Shared { gate, page, sockets: Arc::new(Semaphore::new(MOST_SOCKETS)), messages });
        // The page and its socket are all there is: no file has an address.
        let router = Router::new()
            .route("/{token}/", get(page_of))
            // Browsers ask for an icon by themselves.
            .route("/favicon.ico", get(|| async { StatusCode::NO_CONTENT }))
            .route("/{token}/socket", get(socket_of))
            .layer(middleware::from_fn_with_state(shared.clone(), guarded))
            .layer(DefaultBodyLimit::max(0))
            .with_state(shared);
        connections::serve(listener, router, end).await;
    }
}

/// Refuses what is not from a page of this server, and forbids browsers to keep the answer or to show it elsewhere.
async fn guarded(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let mut response = match shared.gate.refusal(request.headers()) {
        Some(reason) => (StatusCode::FORBIDDEN, reason).into_response(),
        None => next.run(request).await,
    };
    let headers: [(HeaderName, &str); 5] = [
        (CACHE_CONTROL, "no-store"),
        (REFERRER_POLICY, "no-referrer"),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (CONTENT_SECURITY_POLICY, NO_FRAMES),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ];
    for (name, value) in headers {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn page_of(State(shared): State<Arc<Shared>>, Path(token): Path<String>) -> Response {
    if !shared.gate.is_token(&token) {
        return wrong_token();
    }
    ([(CONTENT_TYPE, "text/html; charset=utf-8")], shared.page.clone()).into_response()
}

async fn socket_of(
    State(shared): State<Arc<Shared>>,
    Path(token): Path<String>,
    headers: HeaderMap,
    upgrade: std::result::Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    if !shared.gate.is_token(&token) {
        return wrong_token();
    }
    if let Some(reason) = shared.gate.refusal_of_socket(&headers) {
        return (StatusCode::FORBIDDEN, reason).into_response();
    }
    let Ok(permit) = shared.sockets.clone().try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("{MOST_SOCKETS} pages are open, which is the most: close one\n"))
            .into_response();
    };
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(rejection) => return rejection.into_response(),
    };
    let messages = shared.messages.clone();
    upgrade.max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES).on_upgrade(async move |socket| {
        talk(socket, &*messages).await;
        drop(permit);
    })
}

fn wrong_token() -> Response {
    (StatusCode::FORBIDDEN, "the address has another token than the one that this program has written to its terminal\n")
        .into_response()
}

/// The most bytes of a message of a page.
const MOST_BYTES: usize = 4 << 10;
/// The time for a page to take a notice.
const TAKE_TIME: Duration = Duration::from_secs(10);
/// Between pings. A browser answers them by itself.
const PING_TIME: Duration = Duration::from_secs(5);
/// A page that has said nothing for so long is gone, or never ends its message.
const SILENCE_TIME: Duration = Duration::from_secs(12);

/// The other end of the pages' messages.
pub trait Messages: Send + Sync {
    /// The notices for pages.
    fn board(&self) -> &NoticeBoard;

    /// Takes a message of a page.
    ///
    /// # Errors
    /// If it makes no sense: the reason. The page then loses its socket.
    fn take(&self, text: &str) -> std::result::Result<(), String>;
}

/// Talks to a page until it leaves, falls silent, is too slow, or says what makes no sense.
async fn talk(mut socket: WebSocket, messages: &dyn Messages) {
    let board = messages.board();
    let mut reader = board.reader();
    let mut pings = interval(PING_TIME);
    let mut last_heard = Instant::now();
    loop {
        tokio::select! {
            received = socket.recv() => {
                last_heard = Instant::now();
                let refusal = match received {
                    Some(Ok(Message::Text(text))) => messages.take(&text).err(),
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) => None,
                    Some(Ok(Message::Binary(_))) => Some("messages are text".into()),
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                };
                if let Some(reason) = refusal {
                    // A reason has at most 123 bytes.
                    let reason: String = reason.chars().filter(char::is_ascii).take(120).collect();
                    let close = CloseFrame { code: close_code::POLICY, reason: reason.into() };
                    let _ = timeout(TAKE_TIME, socket.send(Message::Close(Some(close)))).await;
                    return;
                }
            }
            _ = pings.tick() => {
                let ping = socket.send(Message::Ping(Default::default()));
                if last_heard.elapsed() > SILENCE_TIME || !matches!(timeout(TAKE_TIME, ping).await, Ok(Ok(()))) {
                    return;
                }
            }
            notices = reader.next(board) => {
                for notice in notices {
                    if !matches!(timeout(TAKE_TIME, socket.send(Message::Text(notice))).await, Ok(Ok(()))) {
                        return;
                    }
                }
            }
        }
    }
}

/// Bytes of the token.
const TOKEN_BYTES: usize = 16;

/// Who may talk to the server: whoever knows its token, from its own page. It may be asked for under its addresses alone.
#[derive(Debug)]
struct Gate {
    listening: SocketAddr,
    token: String,
}

impl Gate {
    /// A gate with a token that nobody can guess.
    fn new(listening: SocketAddr) -> Result<Gate> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| Error::Usage(format!("the system gives no random numbers: {error}")))?;
        Ok(Gate { listening, token: bytes.iter().map(|byte| format!("{byte:02x}")).collect() })
    }

    /// The address of the page.
    fn address(&self) -> String {
        format!("http://{}/{}/", self.listening, self.token)
    }

    /// Returns true if this is the token. It takes the same time for all tokens of its length.
    fn is_token(&self, token: &str) -> bool {
        let differences = token.bytes().zip(self.token.bytes()).fold(0, |bits, (a, b)| bits | (a ^ b));
        token.len() == self.token.len() && differences == 0
    }

    /// Returns the reason to refuse a request for where it is from and whom it asks, if there is one.
    fn refusal(&self, headers: &HeaderMap) -> Option<&'static str> {
        let mut hosts = headers.get_all(HOST).iter();
        let (Some(host), None) = (hosts.next().and_then(|host| host.to_str().ok()), hosts.next()) else {
            return Some("there must be one Host\n");
        };
        if !self.is_host(host) {
            return Some("the Host is not the address that this program has written to its terminal\n");
        }
        let mut origins = headers.get_all(ORIGIN).iter();
        let is_own = origins.all(|origin| origin.to_str().is_ok_and(|origin| origin.strip_prefix("http://") == Some(host)));
        (!is_own).then_some("the Origin is another page\n")
    }

    /// The same for sockets, which browsers never open without an Origin.
    fn refusal_of_socket(&self, headers: &HeaderMap) -> Option<&'static str> {
        match headers.contains_key(ORIGIN) {
            true => self.refusal(headers),
            false => Some("there must be an Origin\n"),
        }
    }

    /// Returns true if a host is this server. Names other than `localhost` are not: whoever owns one can point it here, and
    /// read with a page of their own what a browser gets from it.
    fn is_host(&self, host: &str) -> bool {
        let Some((name, port)) = host.rsplit_once(':') else { return false };
        let is_loopback = self.listening.ip().is_loopback();
        let is_name = match name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
            Ok(address) if is_loopback => address.is_loopback(),
            Ok(_) => true,
            Err(_) => name == "localhost" && (is_loopback || self.listening.ip().is_unspecified()),
        };
        is_name && port.parse() == Ok(self.listening.port())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(axum::http::HeaderName, &'static str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.clone(), HeaderValue::from_static(value))).collect()
    }

    #[test]
    fn tokens_are_long_and_new_each_time() {
        let gate = Gate::new("127.0.0.1:4000".parse().unwrap()).unwrap();
        let other = Gate::new("127.0.0.1:4000".parse().unwrap()).unwrap();
        assert_eq!(gate.token.len(), 32);
        assert!(gate.is_token(&gate.token) && !gate.is_token(&other.token));
        assert!(!gate.is_token("") && !gate.is_token(&gate.token[1..]) && !gate.is_token(&format!("{}0", gate.token)));
        assert_eq!(gate.address(), format!("http://127.0.0.1:4000/{}/", gate.token));
    }

    #[test]
    fn hosts_are_addresses_of_this_server() {
        let is_host = |listening: &str, host: &str| Gate::new(listening.parse().unwrap()).unwrap().is_host(host);
        for host in ["127.0.0.1:4000", "localhost:4000", "[::1]:4000"] {
            assert!(is_host("127.0.0.1:4000", host), "{host}");
        }
        for host in
            ["127.0.0.1", "127.0.0.1:4001", "localhost:", "evil.example:4000", "192.168.0.2:4000", "localhost.evil:4000", ""]
        {
            assert!(!is_host("127.0.0.1:4000", host), "{host}");
        }
        assert!(is_host("0.0.0.0:4000", "192.168.0.2:4000") && is_host("0.0.0.0:4000", "localhost:4000"));
        assert!(!is_host("0.0.0.0:4000", "evil.example:4000") && !is_host("192.168.0.2:4000", "localhost:4000"));
    }

    #[test]
    fn origins_are_this_page() {
        let gate = Gate::new("127.0.0.1:4000".parse().unwrap()).unwrap();
        let host = (HOST, "127.0.0.1:4000");
        let own = headers(&[host.clone(), (ORIGIN, "http://127.0.0.1:4000")]);
        assert_eq!((gate.refusal(&own), gate.refusal_of_socket(&own)), (None, None));
        assert_eq!(gate.refusal(&headers(std::slice::from_ref(&host))), None);
        assert!(gate.refusal_of_socket(&headers(std::slice::from_ref(&host))).is_some());
        for origin in ["null", "https://127.0.0.1:4000", "http://localhost:4000", "http://127.0.0.1:4001", "http://evil.example"]
        {
            assert!(gate.refusal(&headers(&[host.clone(), (ORIGIN, origin)])).is_some(), "{origin}");
        }
        assert!(gate.refusal(&headers(&[])).is_some());
    }
}
