//! Errors of commands.

use std::{io, time::Duration};

/// An error of a command that drives hardware. Its message names the command.
#[derive(Debug, thiserror::Error)]
#[error("`{command}` {fault}")]
pub struct ExecError {
    /// The command, as it was given.
    pub command: String,
    /// The fault.
    pub fault: ExecFault,
}

/// A fault of a command, with the expectation and the remedy. It completes the sentence that begins with the command.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExecFault {
    /// It cannot be started.
    #[error("cannot be started: {0}; give its path, and check that it may be executed")]
    NotStarted(#[source] io::Error),
    /// It ended before its input did, or closed its output.
    #[error("has ended ({0}), expected answers until its input ends")]
    Ended(#[source] io::Error),
    /// It did not answer.
    #[error("has not answered `{order}` for {:.1} s, expected a line that begins with ok or error", after.as_secs_f32())]
    Silent {
        /// The order.
        order: String,
        /// The time for which it was waited for.
        after: Duration,
    },
    /// It said something that is no answer.
    #[error("said {found}, expected {expected}; what is not an answer belongs on its standard error")]
    Babble {
        /// Its words.
        found: String,
        /// The words that it should have said.
        expected: String,
    },
    /// It answered an order with an error.
    #[error("answered `{order}` with the error: {message}")]
    Refused {
        /// The order.
        order: String,
        /// Its message.
        message: String,
    },
    /// It was ended after another fault, and gets no more orders.
    #[error("has been ended after an error; start again")]
    Closed,
    /// It was ended while it moved the stage, or did not obey an order to stop.
    #[error("may still move the stage: it did not say that it has stopped; use the emergency stop")]
    NotStopped,
    /// It said that a picture is there, but none is.
    #[error("answered `{order}` with ok, but {problem}")]
    NoPicture {
        /// The order.
        order: String,
        /// The problem with the file.
        problem: String,
    },
    /// The order was cancelled.
    #[error("was cancelled")]
    Cancelled,
}

impl From<ExecError> for crate::error::Error {
    fn from(error: ExecError) -> crate::error::Error {
        crate::error::Error::Device(Box::new(error))
    }
}
