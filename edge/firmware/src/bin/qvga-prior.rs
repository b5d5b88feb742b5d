//! The firmware of the profile `qvga-prior`.
#![cfg_attr(target_os = "none", no_std, no_main)]

multiscopic_firmware::firmware!(multiscopic_edge::profile::QVGA_PRIOR);
