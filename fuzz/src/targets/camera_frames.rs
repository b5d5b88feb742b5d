//! Buffers of cameras, in every format.

use arbitrary::{Result, Unstructured};
use multiscopic::capture::camera::{FrameLayout, PixelFormat};

/// Converts a buffer with a layout as a driver describes it.
fn convert(input: &mut Unstructured) -> Result<()> {
    let layout = FrameLayout {
        format: *input.choose(&PixelFormat::ALL)?,
        // Sizes that a buffer of libFuzzer's length can have, and any.
        size: match input.arbitrary()? {
            true => [input.int_in_range(1..=40)?, input.int_in_range(1..=40)?],
            false => [input.arbitrary()?, input.arbitrary()?],
        },
        stride: match input.arbitrary()? {
            true => input.int_in_range(0..=130)?,
            false => input.arbitrary()?,
        },
    };
    let buffer = input.bytes(input.len())?;
    if let Ok(image) = layout.to_gray(buffer) {
        assert_eq!([image.width(), image.height()], layout.size, "the size that the driver said");
    }
    Ok(())
}

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let _ = convert(&mut Unstructured::new(bytes));
    true
}
