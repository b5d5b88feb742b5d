//! The firmware of the profile `vga`.
#![cfg_attr(target_os = "none", no_std, no_main)]

multiscopic_edge::firmware!(multiscopic_edge::profile::VGA);
