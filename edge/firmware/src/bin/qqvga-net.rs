//! The firmware of the profile `qqvga-net`.
#![cfg_attr(target_os = "none", no_std, no_main)]

multiscopic_firmware::firmware!(multiscopic_edge::profile::QQVGA_NET);
