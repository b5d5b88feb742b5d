//! The width of the terminal.

use std::io::{self, IsTerminal};

use terminal_size::{Width, terminal_size};

/// The characters in a line of the terminal, or `None` if standard output goes elsewhere.
pub fn columns() -> Option<usize> {
    let (Width(columns), _) = io::stdout().is_terminal().then(terminal_size).flatten()?;
    Some(columns.into())
}
