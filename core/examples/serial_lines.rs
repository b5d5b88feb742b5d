//! Matches lines that a camera board sends over a serial line when it is asked for them: nothing holds a frame.
//!
//! The port is any `Read` and `Write`. Here it is a board in memory, before which a textured wall stands. On a
//! microcontroller, the traits of `embedded-io` take the place of those of `std`.
//!
//! ```sh
//! cargo run --release -p multiscopic-core --example serial_lines
//! ```

use std::{
    collections::VecDeque,
    io::{self, Read, Write},
};

use multiscopic_core::{BlockMatchingParams, Frame, Fusion, Matcher, ScanlineSource, SearchConfig, View, Views, valid};

const SEARCH: SearchConfig =
    SearchConfig { width: 64, height: 48, views: Views::HORIZONTAL, fusion: Fusion::Min, min_disparity: 0, num_disparities: 16 };
const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(7));

/// The disparity of the wall.
const WALL: i16 = 9;

/// Lines over a port. A request has three bytes: the frame, and the number of the line, low byte first. The reply has
/// the pixels of the line.
struct SerialLines<P> {
    port: P,
}

impl<P: Read + Write> ScanlineSource for SerialLines<P> {
    type Error = io::Error;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> io::Result<()> {
        let [low, high] = (v as u16).to_le_bytes();
        self.port.write_all(&[number(frame), low, high])?;
        // Called again, this asks for the same line again: an error loses nothing.
        self.port.read_exact(line)
    }
}

fn number(frame: Frame) -> u8 {
    match frame {
        Frame::Center => 0,
        Frame::View(View::LEFT) => 1,
        Frame::View(_) => 2,
    }
}

/// A board that answers.
#[derive(Default)]
struct Board {
    replies: VecDeque<u8>,
    lines_sent: usize,
}

impl Write for Board {
    fn write(&mut self, request: &[u8]) -> io::Result<usize> {
        let &[frame, low, high] = request else { return Err(io::ErrorKind::InvalidData.into()) };
        let v = i32::from(u16::from_le_bytes([low, high]));
        let shift = match frame {
            0 => 0,
            1 => View::LEFT.shift(WALL).0,
            _ => View::RIGHT.shift(WALL).0,
        };
        self.replies.extend((0..PARAMS.width() as i32).map(|u| texture(u - shift, v)));
        self.lines_sent += 1;
        Ok(request.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Read for Board {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.replies.read(buffer)
    }
}

/// Noise that is the same each time.
fn texture(u: i32, v: i32) -> u8 {
    let bits = (u.wrapping_mul(0x9e37_79b9_u32 as i32) ^ v.wrapping_mul(0x85eb_ca6b_u32 as i32)) as u32;
    (bits.wrapping_mul(0xc2b2_ae35) >> 24) as u8
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // All that the matcher takes. On a microcontroller: a static.
    let mut memory = [0; PARAMS.memory_words()];
    let mut matcher = Matcher::new(&PARAMS, &mut memory)?;
    let mut source = SerialLines { port: Board::default() };
    let mut line = [None; PARAMS.width()];
    let (mut right, mut pixels) = (0, 0);
    while let Some(_v) = matcher.next_line(&mut source, &mut line)? {
        right += line.iter().flatten().filter(|&&disparity| (f32::from(disparity) - f32::from(WALL)).abs() < 0.5).count();
        pixels += line.len();
    }
    println!(
        "{right} of {pixels} pixels have the disparity of the wall, with {} bytes of memory and {} lines received",
        4 * PARAMS.memory_words(),
        source.port.lines_sent
    );
    assert!(right > pixels * 9 / 10 && source.port.lines_sent == 3 * PARAMS.height());
    Ok(())
}

#[test]
fn the_wall_is_found() {
    main().expect("lines arrive");
}
