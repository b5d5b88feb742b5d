//! The notices of the server to every page: for each subject the newest one, and none of those before it.

use std::sync::{Mutex, PoisonError};

use axum::extract::ws::Utf8Bytes;
use serde::Serialize;
use serde_json::json;
use tokio::sync::watch;

/// The subject of a notice. A page receives them in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// The pictures of the rig.
    Scene,
    /// The folders that can be looked at.
    History,
    /// The match that is under way: its settings, command, code and cost.
    Plan,
    /// The progress of the match.
    Progress,
    /// The newest disparities, or why there are none.
    Result,
    /// The picture of the camera.
    Preview,
    /// The progress of the capture.
    Capture,
}

impl Subject {
    const COUNT: usize = 7;

    fn name(self) -> &'static str {
        match self {
            Subject::Scene => "scene",
            Subject::History => "history",
            Subject::Plan => "plan",
            Subject::Progress => "progress",
            Subject::Result => "result",
            Subject::Preview => "preview",
            Subject::Capture => "capture",
        }
    }
}

/// The newest notice of each subject. A page that is slow misses those in between, so that nothing piles up.
pub struct NoticeBoard {
    notices: Mutex<[Option<(u64, Utf8Bytes)>; Subject::COUNT]>,
    /// The number of notices so far.
    count: watch::Sender<u64>,
}

/// A page's place among the notices.
#[derive(Debug)]
pub struct Reader {
    last: u64,
    count: watch::Receiver<u64>,
}

impl NoticeBoard {
    /// A board without notices.
    pub fn new() -> NoticeBoard {
        NoticeBoard { notices: Mutex::default(), count: watch::Sender::new(0) }
    }

    /// Puts up a notice in the place of the one before.
    pub fn put(&self, subject: Subject, contents: impl Serialize) {
        let text = json!({ "subject": subject.name(), "contents": contents }).to_string();
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        let number = *self.count.borrow() + 1;
        notices[subject as usize] = Some((number, text.into()));
        self.count.send_replace(number);
    }

    /// A reader who has seen nothing.
    pub fn reader(&self) -> Reader {
        Reader { last: 0, count: self.count.subscribe() }
    }

    /// The number of readers.
    pub fn readers(&self) -> usize {
        self.count.receiver_count()
    }
}

impl Reader {
    /// The notices on `board` that this reader has not seen, once there are any.
    pub async fn next(&mut self, board: &NoticeBoard) -> Vec<Utf8Bytes> {
        let last = self.last;
        if self.count.wait_for(|count| *count > last).await.is_err() {
            return std::future::pending().await;
        }
        let notices = board.notices.lock().unwrap_or_else(PoisonError::into_inner);
        self.last = *self.count.borrow_and_update();
        notices.iter().flatten().filter(|(number, _)| *number > last).map(|(_, text)| text.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_sees_the_newest_of_each_subject_once() {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let board = NoticeBoard::new();
        let mut reader = board.reader();
        board.put(Subject::Result, 1);
        board.put(Subject::Result, 2);
        board.put(Subject::Scene, "rig");
        let texts = runtime.block_on(reader.next(&board));
        let texts: Vec<&str> = texts.iter().map(|text| text.as_str()).collect();
        assert_eq!(texts, [r#"{"contents":"rig","subject":"scene"}"#, r#"{"contents":2,"subject":"result"}"#]);
        board.put(Subject::Preview, ());
        assert_eq!(runtime.block_on(reader.next(&board)).len(), 1);
        assert_eq!(board.readers(), 1);
        drop(reader);
        assert_eq!(board.readers(), 0);
    }
}
