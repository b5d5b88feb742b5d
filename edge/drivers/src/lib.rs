//! Drivers over `embedded-hal` 1.0 for capturing multiscopic frames on a microcontroller.
//!
//! They implement the [`Stage`](multiscopic_core::capture::Stage) and the
//! [`Camera`](multiscopic_core::capture::Camera) of the core, so that its
//! [`Sequence`](multiscopic_core::capture::Sequence) moves the camera and takes the frames. Each is a feature
//! of its name; both are on by default.
//!
//! | module | what it is |
//! | --- | --- |
//! | `stepper` | a stage of two axes with stepping motors |
//! | `hm01b0` | a camera with the sensor HM01B0 |
#![no_std]

#[cfg(feature = "hm01b0")]
pub mod hm01b0;
#[cfg(feature = "stepper")]
pub mod stepper;
