#!/bin/sh
# Generates src/videodev2.rs from this machine's linux/videodev2.h, limited to what the crate v4l uses.
# Needs bindgen, libclang and the kernel's headers (Debian: bindgen, linux-libc-dev).
set -eu
cd "$(dirname "$0")"
types='audio|audioout|buffer|capability|captureparm|control|crop|cropcap|edid|enc_idx|encoder_cmd|exportbuffer|ext_control|ext_controls'
types="$types|fmtdesc|format|fract|framebuffer|frequency|frmivalenum|frmivaltypes|frmsizeenum|frmsizetypes|input|jpegcompression|modulator|output|outputparm"
types="$types|pix_format|query_ext_ctrl|queryctrl|querymenu|requestbuffers|sliced_vbi_cap|standard|std_id|streamparm|tuner"
echo '#include <linux/videodev2.h>' | bindgen --no-layout-tests --no-doc-comments --no-derive-debug \
    --blocklist-type 'timeval|timespec|__time_t|__suseconds_t|__syscall_slong_t' --raw-line 'pub use libc::{time_t, timeval};' \
    --allowlist-type "v4l2_($types)" --allowlist-var 'V4L2_CTRL_FLAG_NEXT_(CTRL|COMPOUND)' \
    --opaque-type 'v4l2_ctrl_.*' \
    --output src/videodev2.rs /dev/stdin -- -x c
