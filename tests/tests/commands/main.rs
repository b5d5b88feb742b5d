//! The command line as users run it.

mod alignment;
mod arrays;
mod command_line;
mod edge_commands;
mod evaluation;
mod filters;
mod interruptions;
mod lenses;
mod live_view;
mod photos;
mod picking;
mod scenes;
mod search;
mod shards;
