//! Linux's V4L2 structures for the crate `v4l`, generated in advance by `generate.sh` so that building needs no libclang.
//!
//! One file serves all architectures, since it uses C types.
#![cfg(target_os = "linux")]
#![allow(missing_docs, nonstandard_style, clippy::all, reason = "names and documentation are the kernel's")]

include!("videodev2.rs");

/// The sizes that the kernel encodes in its ioctl numbers (`_IOC_SIZE`) on 64-bit machines.
#[cfg(target_pointer_width = "64")]
const _: () = {
    assert!(size_of::<v4l2_capability>() == 104);
    assert!(size_of::<v4l2_fmtdesc>() == 64);
    assert!(size_of::<v4l2_format>() == 208);
    assert!(size_of::<v4l2_requestbuffers>() == 20);
    assert!(size_of::<v4l2_buffer>() == 88);
    assert!(size_of::<v4l2_streamparm>() == 204);
    assert!(size_of::<v4l2_frmsizeenum>() == 44);
    assert!(size_of::<v4l2_query_ext_ctrl>() == 232);
    assert!(size_of::<v4l2_ext_controls>() == 32);
    assert!(size_of::<v4l2_ext_control>() == 20);
};
