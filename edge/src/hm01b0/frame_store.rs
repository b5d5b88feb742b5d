//! Where frames are kept until they are matched.

use core::{error, fmt};
use multiscopic_core::{Frame, Params, Rewind, ScanlineSource};

/// A place for whole frames: memory of the microcontroller or beside it, flash, files.
pub trait FrameStore: ScanlineSource {
    /// Keeps line `v` of a frame. Lines come in order, from the first again if the frame is taken again.
    ///
    /// # Errors
    /// The store's own.
    fn write_line(&mut self, frame: Frame, v: usize, line: &[u8]) -> Result<(), Self::Error>;
}

/// Frames in memory, one after the other, the centre first.
///
/// ```
/// use multiscopic_core::{Frame, Fusion, Params, Views};
/// use multiscopic_edge::hm01b0::FrameMemory;
///
/// const PARAMS: Params = match Params::new(160, 120, Views::HORIZONTAL, Fusion::Min, 1, 16, 7) {
///     Ok(params) => params,
///     Err(_) => panic!("the parameters are out of range"),
/// };
/// // Two of three: the last view is matched as it is read out.
/// const BYTES: usize = 2 * PARAMS.width() * PARAMS.height();
///
/// let mut pixels = [0; BYTES]; // a static in firmware
/// let store = FrameMemory::new(&PARAMS, &mut pixels);
/// ```
#[derive(Debug)]
pub struct FrameMemory<'m> {
    pixels: &'m mut [u8],
    params: Params,
}

impl<'m> FrameMemory<'m> {
    /// Frames of the size and in the order of `params`, as many as fit into `pixels`: a byte for each pixel.
    pub fn new(params: &Params, pixels: &'m mut [u8]) -> FrameMemory<'m> {
        FrameMemory { pixels, params: *params }
    }

    fn line(&mut self, frame: Frame, v: usize) -> Result<&mut [u8], NoRoom> {
        let place = match frame {
            Frame::Center => Some(0),
            Frame::View(view) => self.params.views().iter().position(|other| other == view).map(|place| place + 1),
        };
        let (width, height) = (self.params.width(), self.params.height());
        let start = place.filter(|_| v < height).map(|place| (place * height + v) * width);
        start.and_then(|start| self.pixels.get_mut(start..start + width)).ok_or(NoRoom { frame, line: v })
    }
}

impl ScanlineSource for FrameMemory<'_> {
    type Error = NoRoom;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), NoRoom> {
        let kept = self.line(frame, v)?;
        line.get_mut(..kept.len()).ok_or(NoRoom { frame, line: v })?.copy_from_slice(kept);
        Ok(())
    }
}

impl Rewind for FrameMemory<'_> {
    fn rewind(&mut self) -> Result<(), NoRoom> {
        Ok(())
    }
}

impl FrameStore for FrameMemory<'_> {
    fn write_line(&mut self, frame: Frame, v: usize, line: &[u8]) -> Result<(), NoRoom> {
        let kept = self.line(frame, v)?;
        kept.copy_from_slice(line.get(..kept.len()).ok_or(NoRoom { frame, line: v })?);
        Ok(())
    }
}

/// There is no room for a line: the frame is not one of the match, or the memory is too small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoRoom {
    /// The frame.
    pub frame: Frame,
    /// The line.
    pub line: usize,
}

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "there is no room for line {} of frame {:?}", self.line, self.frame)
    }
}

impl error::Error for NoRoom {}
