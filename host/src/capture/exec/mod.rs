//! Commands that drive hardware of any kind: a child process that reads orders from its standard input, a line each, and answers
//! each with a line on its standard output.
//!
//! The answer is `ok`, perhaps with values behind it, or `error` and a message. A command may take its time over an order, but
//! reads those that come meanwhile. It ends when its input does. What it writes to its standard error goes to the user.
//! `docs/capture.md` has the orders of stages and of cameras.
//!
//! A command that is silent, or says something else, gets no more orders. Its input ends, upon which it must stop what it moves,
//! and two seconds later it is killed with all processes that it started.

mod child;
mod dialog;
mod error;

pub(super) use child::ChildPort;
pub(super) use dialog::Dialog;
pub use error::{ExecError, ExecFault};

/// Refuses the text of a command that does not split into words, as a shell splits them. No shell runs.
pub(super) fn words(command: &str) -> Result<Vec<String>, &'static str> {
    let words = shlex::split(command).ok_or("a quotation is not closed")?;
    if words.is_empty() { Err("the command is missing") } else { Ok(words) }
}
