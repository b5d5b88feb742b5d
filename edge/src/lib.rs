//! Firmware side of multiscopic.
#![no_std]
