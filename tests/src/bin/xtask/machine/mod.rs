//! A virtual machine with cameras.

pub mod archive;
pub mod linux;
pub mod virtual_machine;
