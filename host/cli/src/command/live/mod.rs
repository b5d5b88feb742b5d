//! `multiscopic tune` and `multiscopic live`: a page on which a rig is matched while the options of `match` are set, and a camera
//! takes further rigs.

mod frame_meters;
mod live_command;
mod live_page;
mod live_source;
mod notice_board;
mod server;
mod serving;
mod studio;
mod tuner;
mod tuning;

pub use live_command::Live;
pub use tuner::Tune;
