//! Keeps frames until they are matched.

use core::{error, fmt};
use multiscopic_core::{BlockMatchingParams, Frame, Rewind, ScanlineSource};

/// A store of whole frames: internal or external memory, flash, files.
pub trait FrameStore: ScanlineSource {
    /// Stores line `v` of a frame. Lines ascend, and start again from 0 if the frame is taken again.
    ///
    /// # Errors
    /// Those of the store.
    fn write_line(&mut self, frame: Frame, v: usize, line: &[u8]) -> Result<(), Self::Error>;
}

/// Frames in memory, one after the other: the centre, then the views of the match in the order of
/// [`Views`](multiscopic_core::Views).
///
/// ```
/// use multiscopic_core::{BlockMatchingParams, Frame, Fusion, SearchConfig, Views};
/// use multiscopic_drivers::hm01b0::FrameMemory;
///
/// const SEARCH: SearchConfig =
///     SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SearchConfig::of_size(160, 120) };
/// const PARAMS: BlockMatchingParams = match SEARCH.block_matching(7) {
///     Ok(params) => params,
///     Err(_) => panic!("the parameters are out of range"),
/// };
/// // Two of the three frames: the last view is matched during readout.
/// const BYTES: usize = 2 * PARAMS.width() * PARAMS.height();
///
/// let mut pixels = [0; BYTES]; // a static in firmware
/// let store = FrameMemory::new(&PARAMS, &mut pixels);
/// ```
#[derive(Debug)]
pub struct FrameMemory<'m> {
    pixels: &'m mut [u8],
    params: BlockMatchingParams,
}

impl<'m> FrameMemory<'m> {
    /// A store for frames of the size in `params`. It holds as many as fit into `pixels`, one byte a pixel.
    pub fn new(params: &BlockMatchingParams, pixels: &'m mut [u8]) -> FrameMemory<'m> {
        FrameMemory { pixels, params: *params }
    }

    fn line(&mut self, frame: Frame, v: usize) -> Result<&mut [u8], NoRoom> {
        let index = match frame {
            Frame::Center => Some(0),
            Frame::View(view) => self.params.views().iter().position(|stored| stored == view).map(|index| index + 1),
        };
        let (width, height) = (self.params.width(), self.params.height());
        let start = index.filter(|_| v < height).map(|index| (index * height + v) * width);
        start.and_then(|start| self.pixels.get_mut(start..start + width)).ok_or(NoRoom { frame, line: v })
    }
}

impl ScanlineSource for FrameMemory<'_> {
    type Error = NoRoom;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), NoRoom> {
        let stored = self.line(frame, v)?;
        line.get_mut(..stored.len()).ok_or(NoRoom { frame, line: v })?.copy_from_slice(stored);
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
        let stored = self.line(frame, v)?;
        stored.copy_from_slice(line.get(..stored.len()).ok_or(NoRoom { frame, line: v })?);
        Ok(())
    }
}

/// The store has no place for a line: the frame is not part of the match, or the memory is too small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoRoom {
    /// The frame.
    pub frame: Frame,
    /// The line.
    pub line: usize,
}

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the store has no room for line {} of frame {:?}", self.line, self.frame)
    }
}

impl error::Error for NoRoom {}
