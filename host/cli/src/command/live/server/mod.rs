//! The server of the page: who may talk to it, and how much.

mod connections;
mod gate;

use std::{net::SocketAddr, sync::Arc};

use axum::{
    Router,
    extract::{DefaultBodyLimit, Path, Request, State, WebSocketUpgrade, ws::rejection::WebSocketUpgradeRejection},
    http::{
        HeaderMap, HeaderName, HeaderValue, StatusCode,
        header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS},
    },
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};
use multiscopic::{Error, Result};
use tokio::{net::TcpListener, sync::Semaphore};

pub use self::connections::Messages;
use self::gate::Gate;

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
    upgrade.max_message_size(connections::MOST_BYTES).max_frame_size(connections::MOST_BYTES).on_upgrade(async move |socket| {
        connections::talk(socket, &*messages).await;
        drop(permit);
    })
}

fn wrong_token() -> Response {
    (StatusCode::FORBIDDEN, "the address has another token than the one that this program has written to its terminal\n")
        .into_response()
}
