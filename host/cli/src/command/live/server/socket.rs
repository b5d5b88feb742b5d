//! The socket of a page: notices go out, and wishes come in.

use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use tokio::time::{Instant, interval, timeout};

use crate::command::live::notice_board::NoticeBoard;

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
