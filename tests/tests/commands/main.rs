//! The command line, as a user runs it.

mod alignment;
mod command_line;
mod edge_commands;
