//! The command line as users run it.

mod alignment;
mod command_line;
mod edge_commands;
