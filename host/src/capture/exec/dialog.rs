//! Orders to a command, and its answers in their order.

use std::{
    collections::VecDeque,
    io::{self, Read, Write},
    sync::Arc,
    time::{Duration, Instant},
};

use super::error::{ExecError, ExecFault};
use crate::capture::{
    Clock,
    lines::{LineFault, Lines},
};

/// The longest part of a line that a message repeats, in characters.
const MOST_REPEATED: usize = 80;

/// The expectation of a command that has no order to answer.
const NO_ORDER: &str = "nothing before the next order";

/// A conversation with a command. After an error that is not a refusal, it has ended.
pub(in crate::capture) struct Dialog<P> {
    command: String,
    /// `None` once it has ended.
    lines: Option<Lines<P>>,
    clock: Arc<dyn Clock>,
    /// The orders that have not been answered, the oldest first.
    orders: VecDeque<String>,
}

impl<P: Read + Write> Dialog<P> {
    /// A conversation over `port`, whose reads must return after a short while of the time of `clock`.
    pub fn new(port: P, command: &str, clock: Arc<dyn Clock>) -> Dialog<P> {
        let lines = Some(Lines::new(port, clock.clone()));
        Dialog { command: command.into(), lines, clock, orders: VecDeque::new() }
    }

    /// The current time.
    pub fn now(&self) -> Instant {
        self.clock.now()
    }

    /// An error of this command.
    pub fn error(&self, fault: ExecFault) -> ExecError {
        ExecError { command: self.command.clone(), fault }
    }

    /// Ends the conversation with a fault.
    pub fn end(&mut self, fault: ExecFault) -> ExecError {
        self.lines = None;
        self.orders.clear();
        self.error(fault)
    }

    /// Returns true if the conversation has ended.
    pub fn has_ended(&self) -> bool {
        self.lines.is_none()
    }

    /// Fails if the command has said something without an order.
    pub fn check_quiet(&mut self) -> Result<(), ExecError> {
        let Some(line) = self.next_line(self.now())? else { return Ok(()) };
        Err(self.babble(&line, NO_ORDER))
    }

    /// Gives an order.
    pub fn tell(&mut self, order: &str) -> Result<(), ExecError> {
        let Some(lines) = &mut self.lines else { return Err(self.error(ExecFault::Closed)) };
        // It may follow the order even if sending seems to fail.
        self.orders.push_back(order.into());
        lines.send(format!("{order}\n").as_bytes()).map_err(|source| self.ended(source))
    }

    /// The words behind the `ok` that answers the oldest order, if the answer is there by `deadline`.
    pub fn answer(&mut self, deadline: Instant) -> Result<Option<String>, ExecError> {
        let Some(line) = self.next_line(deadline)? else { return Ok(None) };
        let Some(order) = self.orders.pop_front() else { return Err(self.babble(&line, NO_ORDER)) };
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
        match word {
            "ok" => Ok(Some(rest.trim().into())),
            "error" => {
                let message = if rest.is_empty() { "none given".into() } else { shortened(rest.trim()) };
                Err(self.error(ExecFault::Refused { order, message }))
            }
            _ => Err(self.babble(&line, &format!("ok or error in answer to `{order}`"))),
        }
    }

    /// The words behind the `ok` that answers the oldest order, which must be there within `patience`.
    pub fn expect(&mut self, patience: Duration) -> Result<String, ExecError> {
        let deadline = self.now() + patience;
        match self.answer(deadline)? {
            Some(answer) => Ok(answer),
            None => {
                let order = self.orders.front().cloned().unwrap_or_default();
                Err(self.end(ExecFault::Silent { order, after: patience }))
            }
        }
    }

    /// Gives an order, and returns the words behind the `ok` that answers it within `patience`.
    pub fn ask(&mut self, order: &str, patience: Duration) -> Result<String, ExecError> {
        self.check_quiet()?;
        self.tell(order)?;
        self.expect(patience)
    }

    /// Ends the conversation since the command said something that it should not.
    pub fn babble(&mut self, line: &str, expected: &str) -> ExecError {
        self.end(ExecFault::Babble { found: format!("`{}`", shortened(line)), expected: expected.into() })
    }

    fn next_line(&mut self, deadline: Instant) -> Result<Option<String>, ExecError> {
        let Some(lines) = &mut self.lines else { return Err(self.error(ExecFault::Closed)) };
        lines.next(deadline).map_err(|fault| match fault {
            LineFault::Ended(source) => self.ended(source),
            LineFault::TooLong(count) => {
                let found = format!("{count} bytes without an end of line");
                self.end(ExecFault::Babble { found, expected: "lines".into() })
            }
        })
    }

    fn ended(&mut self, source: io::Error) -> ExecError {
        self.end(ExecFault::Ended(source))
    }
}

/// The beginning of a text, without what commands a terminal.
fn shortened(text: &str) -> String {
    text.chars().take(MOST_REPEATED).map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect()
}
