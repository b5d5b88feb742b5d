//! Connections, a limited number of them, each for a limited time, and the sockets of pages.

use std::{sync::Arc, time::Duration};

use axum::{
    Router,
    extract::ws::{CloseFrame, Message, WebSocket, close_code},
};
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use tokio::{
    net::{TcpListener, TcpStream},
    sync::Semaphore,
    time::{Instant, interval, sleep, timeout},
};

use crate::command::live::notice_board::NoticeBoard;

/// The most connections that have not become sockets of pages. Further ones are closed at once.
const MOST_CONNECTIONS: usize = 64;
/// The time for the head of a request.
const HEAD_TIME: Duration = Duration::from_secs(5);
/// The time for a request and its answer.
const REQUEST_TIME: Duration = Duration::from_secs(20);
/// Bytes of a request's head.
const MOST_HEAD_BYTES: usize = 16 << 10;
const MOST_HEADERS: usize = 64;
/// The time to wait if the system has no connection to give, as when it has no more files.
const PAUSE: Duration = Duration::from_millis(50);

/// Serves connections until `end` is complete.
pub async fn serve(listener: TcpListener, router: Router, end: impl Future<Output = ()>) {
    let permits = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    tokio::pin!(end);
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = &mut end => return,
        };
        match (accepted, permits.clone().try_acquire_owned()) {
            (Ok((stream, _)), Ok(permit)) => {
                let router = router.clone();
                tokio::spawn(async move {
                    let _ = timeout(REQUEST_TIME, answer(stream, router)).await;
                    drop(permit);
                });
            }
            (Ok(_), Err(_)) => {}
            (Err(_), _) => sleep(PAUSE).await,
        }
    }
}

/// Answers the request of a connection. A socket goes on by itself.
async fn answer(stream: TcpStream, router: Router) {
    let _ = stream.set_nodelay(true);
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .keep_alive(false)
        .max_buf_size(MOST_HEAD_BYTES)
        .max_headers(MOST_HEADERS)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    // Whoever breaks off need not be told.
    let _ = connection.await;
}

/// The most bytes of a message of a page.
pub const MOST_BYTES: usize = 4 << 10;
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
    fn take(&self, text: &str) -> Result<(), String>;
}

/// Talks to a page until it leaves, falls silent, is too slow, or says what makes no sense.
pub async fn talk(mut socket: WebSocket, messages: &dyn Messages) {
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
