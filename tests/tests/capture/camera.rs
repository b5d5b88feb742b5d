//! The grey values of camera frames equal their definition in all formats.

use image::{GrayImage, RgbImage, codecs::jpeg::JpegEncoder};
use multiscopic::{
    Picture,
    capture::camera::{CameraFault, FrameLayout, PixelFormat},
};
use multiscopic_reference::split_mix::Random;
use multiscopic_tests::simulated::cameras::{frame_bytes, luma, pixel_bytes};
use proptest::prelude::*;

/// A format, a size, a stride with padding or unspecified, and enough random bytes for any format.
fn frames() -> impl Strategy<Value = (PixelFormat, [u32; 2], u32, Vec<u8>)> {
    let format =
        proptest::sample::select(PixelFormat::ALL.into_iter().filter(|format| !format.is_compressed()).collect::<Vec<_>>());
    (format, 1u32..30, 1u32..12, proptest::option::of(0u32..9), any::<u64>()).prop_map(
        |(format, width, height, padding, seed)| {
            let stride = padding.map_or(0, |padding| width * pixel_bytes(format) as u32 + padding);
            let mut random = Random(seed);
            (format, [width, height], stride, (0..3000).map(|_| random.byte()).collect())
        },
    )
}

proptest! {
    #[test]
    fn grey_equals_the_definition((format, size, stride, frame) in frames()) {
        let layout = FrameLayout { format, size, stride };
        let image = layout.to_gray(&frame).unwrap();
        prop_assert_eq!(<[u32; 2]>::from(image.dimensions()), size);
        prop_assert_eq!(image.into_raw(), luma(&layout, &frame));
    }

    #[test]
    fn every_truncation_is_an_error((format, size, stride, frame) in frames()) {
        let layout = FrameLayout { format, size, stride };
        let Err(CameraFault::Truncated { found: 0, expected, .. }) = layout.to_gray(&[]) else { panic!("nothing is no frame") };
        let expected = expected as usize;
        let whole = layout.to_gray(&frame[..expected]).unwrap();
        prop_assert_eq!(whole.into_raw(), luma(&layout, &frame));
        for length in 0..expected {
            let is_named = matches!(layout.to_gray(&frame[..length]),
                Err(CameraFault::Truncated { found, expected: e, .. }) if (found, e) == (length as u64, expected as u64));
            prop_assert!(is_named, "{} of {} bytes", length, expected);
        }
    }
}

/// The planes of chroma belong to a frame, as Linux's documentation of the formats says.
#[test]
fn frames_have_the_bytes_of_their_planes() {
    for format in PixelFormat::ALL.into_iter().filter(|format| !format.is_compressed()) {
        let bytes = |size: [u32; 2], stride| match (FrameLayout { format, size, stride }).to_gray(&[]) {
            Err(CameraFault::Truncated { expected, .. }) => expected as usize,
            other => panic!("{format:?}: {other:?}"),
        };
        assert_eq!(bytes([8, 6], 0), frame_bytes(format, [8, 6]), "{format:?}");
        // All rows but the last are padded: those of luma by 8 bytes, those of separate planes of chroma by 4.
        let padded = bytes([8, 6], 8 * pixel_bytes(format) as u32 + 8) - frame_bytes(format, [8, 6]);
        let expected = match format {
            PixelFormat::Nv12 | PixelFormat::Nv21 => 8 * 8,
            PixelFormat::Yu12 | PixelFormat::Yv12 => 6 * 8 + 5 * 4,
            _ => 5 * 8,
        };
        assert_eq!(padded, expected, "{format:?}");
    }
}

/// Drivers may claim any size.
#[test]
fn absurd_layouts_do_no_harm() {
    for format in PixelFormat::ALL {
        for (size, stride) in
            [([u32::MAX; 2], 0), ([u32::MAX; 2], u32::MAX), ([1, u32::MAX], u32::MAX), ([0, 0], 0), ([0, 5], 0), ([5, 0], 0)]
        {
            let layout = FrameLayout { format, size, stride };
            match layout.to_gray(&[7; 100]) {
                Ok(image) => assert!(image.is_empty() && <[u32; 2]>::from(image.dimensions()) == size, "{layout:?}"),
                Err(CameraFault::Truncated { found: 100, expected, .. }) => assert!(expected > 1 << 32, "{layout:?}"),
                Err(error) => assert!(format.is_compressed(), "{layout:?}: {error}"),
            }
        }
    }
}

#[test]
fn sixteen_bit_samples_lose_their_low_bits() {
    for (format, words, gray) in [
        (PixelFormat::Y10, [0x03FFu16, 0x0200, 0x0003], [255, 128, 0]),
        (PixelFormat::Y12, [0x0FFF, 0x0800, 0x000F], [255, 128, 0]),
        (PixelFormat::Y16, [0xFFFF, 0x8000, 0x00FF], [255, 128, 0]),
    ] {
        let layout = FrameLayout { format, size: [3, 1], stride: 6 };
        assert_eq!(layout.to_gray(&words.map(u16::to_le_bytes).concat()).unwrap().as_raw(), &gray);
    }
}

/// A frame of a JPEG camera, and the image it must decode to.
fn jpeg() -> (FrameLayout, Vec<u8>, GrayImage) {
    let scene = RgbImage::from_fn(23, 9, |u, v| image::Rgb([(u * 11) as u8, (v * 28) as u8, (u * v) as u8]));
    let mut bytes = Vec::new();
    JpegEncoder::new(&mut bytes).encode_image(&scene).unwrap();
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), &bytes).unwrap();
    let gray = Picture::read(file.path()).unwrap().to_gray();
    (FrameLayout { format: PixelFormat::Mjpg, size: [23, 9], stride: 0 }, bytes, gray)
}

#[test]
fn a_jpeg_frame_decodes_like_a_jpeg_file() {
    let (layout, mut bytes, gray) = jpeg();
    assert_eq!(layout.to_gray(&bytes).unwrap(), gray);
    // Cameras pad their buffers.
    bytes.extend([0; 100]);
    assert_eq!(layout.to_gray(&bytes).unwrap(), gray);
}

/// Most cameras leave out the Huffman tables, which are always the same.
#[test]
fn a_jpeg_frame_needs_no_huffman_tables() {
    let (layout, bytes, gray) = jpeg();
    let (mut rest, mut without) = (&bytes[2..], bytes[..2].to_vec());
    while rest[1] != 0xDA {
        let (segment, next) = rest.split_at(2 + usize::from(u16::from_be_bytes([rest[2], rest[3]])));
        if segment[1] != 0xC4 {
            without.extend(segment);
        }
        rest = next;
    }
    without.extend(rest);
    assert!(without.len() + 400 < bytes.len(), "there were tables");
    assert_eq!(layout.to_gray(&without).unwrap(), gray);
}

#[test]
fn a_frame_that_is_not_jpeg_is_an_error() {
    let (layout, bytes, _) = jpeg();
    // Without the marker at its end, a frame is whole.
    for length in 0..bytes.len() - 2 {
        assert!(matches!(layout.to_gray(&bytes[..length]), Err(CameraFault::Jpeg { .. })), "{length} of {} bytes", bytes.len());
    }
    let other = FrameLayout { size: [9, 23], ..layout };
    let message = other.to_gray(&bytes).unwrap_err().to_string();
    assert!(message.starts_with("found an image of 23x9, expected a complete JPEG image of 9x23 MJPG"), "{message}");
}

/// The colours of a frame: those of ITU-T T.871 for luma and chroma, of which two pixels of a row share a sample, and so do two rows if
/// chroma has planes of its own.
#[test]
fn colours_equal_the_definition() {
    let (size, frame) = ([4, 2], (0..24).map(|k| (k * 11 + 5) as u8).collect::<Vec<_>>());
    let luma = |v: usize, u: usize| f64::from(frame[4 * v + u]);
    let at = |k: usize| f64::from(frame[k]);
    // Pixel (v, u) of each format: luma, blue and red.
    let packed = |v: usize, u: usize| 8 * v + 4 * (u / 2);
    type Samples<'a> = Box<dyn Fn(usize, usize) -> [f64; 3] + 'a>;
    let formats: [(PixelFormat, Samples); 8] = [
        (PixelFormat::Nv12, Box::new(|v, u| [luma(v, u), at(8 + 2 * (u / 2)), at(9 + 2 * (u / 2))])),
        (PixelFormat::Nv21, Box::new(|v, u| [luma(v, u), at(9 + 2 * (u / 2)), at(8 + 2 * (u / 2))])),
        (PixelFormat::Yu12, Box::new(|v, u| [luma(v, u), at(8 + u / 2), at(10 + u / 2)])),
        (PixelFormat::Yv12, Box::new(|v, u| [luma(v, u), at(10 + u / 2), at(8 + u / 2)])),
        (PixelFormat::Yuyv, Box::new(|v, u| [at(8 * v + 2 * u), at(packed(v, u) + 1), at(packed(v, u) + 3)])),
        (PixelFormat::Yvyu, Box::new(|v, u| [at(8 * v + 2 * u), at(packed(v, u) + 3), at(packed(v, u) + 1)])),
        (PixelFormat::Uyvy, Box::new(|v, u| [at(8 * v + 2 * u + 1), at(packed(v, u)), at(packed(v, u) + 2)])),
        (PixelFormat::Vyuy, Box::new(|v, u| [at(8 * v + 2 * u + 1), at(packed(v, u) + 2), at(packed(v, u))])),
    ];
    for (format, samples) in formats {
        let Picture::Rgb(found) = (FrameLayout { format, size, stride: 0 }).to_picture(&frame).unwrap() else {
            panic!("{format:?} is grey")
        };
        for (u, v, pixel) in found.enumerate_pixels() {
            let [y, cb, cr] = samples(v as usize, u as usize);
            let (cb, cr) = (cb - 128.0, cr - 128.0);
            let expected = [y + 1.402 * cr, y - (0.114 * 1.772 * cb + 0.299 * 1.402 * cr) / 0.587, y + 1.772 * cb];
            let is_near = expected.iter().zip(pixel.0).all(|(a, b)| (a.clamp(0.0, 255.0) - f64::from(b)).abs() < 0.501);
            assert!(is_near, "{format:?} at {u}, {v}: {pixel:?} instead of {expected:?}");
        }
    }
    let rgb = |format| match (FrameLayout { format, size: [4, 2], stride: 0 }).to_picture(&frame).unwrap() {
        Picture::Rgb(image) => image.get_pixel(1, 1).0,
        picture => panic!("{format:?}: {picture:?}"),
    };
    let [a, b, c] = [15, 16, 17].map(|k: usize| frame[k]);
    assert_eq!((rgb(PixelFormat::Rgb3), rgb(PixelFormat::Bgr3)), ([a, b, c], [c, b, a]));
}

/// A colour that cannot hold the luma loses it: else the grey of the colours is the luma, but for rounding.
#[test]
fn the_grey_of_colours_is_luma() {
    for (luma, blue, red) in [(128, 128, 128), (100, 90, 160), (200, 150, 110), (16, 128, 128), (235, 120, 130)] {
        let layout = FrameLayout { format: PixelFormat::Yuyv, size: [2, 1], stride: 0 };
        let gray = layout.to_picture(&[luma, blue, luma, red]).unwrap().to_gray();
        assert!(gray.as_raw().iter().all(|gray| gray.abs_diff(luma) <= 1), "{luma} {blue} {red}: {gray:?}");
    }
}
