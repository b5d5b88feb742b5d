//! The firmware of the profile `qvga-confidence`.
#![cfg_attr(target_os = "none", no_std, no_main)]

multiscopic_firmware::firmware!(multiscopic_edge::profile::QVGA_CONFIDENCE);
