//! The source of rectified lines.

use core::{error, fmt, iter, mem};

use super::{frame_grids::Rectification, source_lines::SourceLines};
use crate::{Disparity, Frame, MemoryTooSmall, Rewind, ScanlineSource, Views};

/// The lines of another source, rectified. [`Rectification`] defines the grey values.
///
/// The other source is asked for each line of its frames once, in ascending order, and no earlier than a rectified line
/// needs it; for the rest of a frame with the last rectified line. The caller lends the memory for the lines that lie
/// between those that a rectified line needs. Lines of the [prior](ScanlineSource::read_prior) are handed on as they are.
///
/// ```
/// use multiscopic_core::{Displacement, DisplacementGrid, Frame, Rectification, Rectified, ScanlineSource, Views};
///
/// /// A horizontal edge, but the camera was tilted: the edge is half a line lower with each column.
/// struct TiltedEdge;
///
/// impl ScanlineSource for TiltedEdge {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, _frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         for (pixel, u) in line.iter_mut().zip(0..) {
///             *pixel = (100 + 20 * (2 * v as i32 - u)).clamp(0, 200) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// const GRID: DisplacementGrid = DisplacementGrid::new(8, 6, 8).unwrap();
/// /// None at the left, four lines down at column 8.
/// const TILT: [Displacement; GRID.nodes()] = {
///     let (straight, tilted) = (Displacement::ZERO, Displacement { right: 0, down: 4 * 64 });
///     [straight, tilted, straight, tilted]
/// };
/// const RECTIFICATION: Rectification = match Rectification::new(GRID, &TILT, &[]) {
///     Ok(rectification) => rectification,
///     Err(_) => panic!("a displacement is missing"),
/// };
/// // Line 0 is made of the lines 0 to 4 of the source: from 0 at column 0 to 3.5 at column 7.
/// assert_eq!(RECTIFICATION.stored_lines(Frame::Center), 5);
///
/// let mut memory = [0; RECTIFICATION.memory(Views::NONE).words()];
/// let mut rectified = Rectified::new(TiltedEdge, &RECTIFICATION, Views::NONE, &mut memory)?;
/// let mut line = [0; 8];
/// rectified.read_line(Frame::Center, 0, &mut line)?;
/// assert_eq!(line, [100; 8]);
/// rectified.read_line(Frame::Center, 1, &mut line)?;
/// assert_eq!(line, [140; 8]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Rectified<'m, S> {
    source: S,
    width: usize,
    /// The centre, and the views.
    frames: [Option<SourceLines<'m>>; 1 + Views::MAX],
}

impl<'m, S> Rectified<'m, S> {
    /// Rectifies the centre and `views` of `source`.
    ///
    /// `memory` has at least the [`words`](crate::Memory::words) that [`Rectification::memory`] states for `views`, with any
    /// content.
    ///
    /// # Errors
    /// [`MemoryTooSmall`].
    pub fn new(
        source: S,
        rectification: &Rectification<'m>,
        views: Views,
        memory: &'m mut [u32],
    ) -> Result<Rectified<'m, S>, MemoryTooSmall> {
        let width = rectification.grid().width();
        let too_small = MemoryTooSmall { needed: rectification.memory(views).words(), given: memory.len() };
        let mut rest: &'m mut [u8] = bytemuck::cast_slice_mut(memory);
        let mut frames = [const { None }; 1 + Views::MAX];
        let names = iter::once(Frame::Center).chain(views.iter().map(Frame::View));
        for (lines, frame) in frames.iter_mut().zip(names) {
            let count = rectification.stored_lines(frame);
            let (ring, others) = mem::take(&mut rest).split_at_mut_checked(count * width).ok_or(too_small)?;
            rest = others;
            *lines = Some(SourceLines::new(frame, rectification.displacements(frame), ring, count));
        }
        Ok(Rectified { source, width, frames })
    }
}

impl<S: ScanlineSource> ScanlineSource for Rectified<'_, S> {
    type Error = RectifiedError<S::Error>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        if line.len() != self.width {
            return Err(RectifiedError::LineLength { needed: self.width, given: line.len() });
        }
        let lines = self.frames.iter_mut().flatten().find(|lines| lines.frame == frame);
        let Some(lines) = lines.filter(|lines| lines.takes(v)) else {
            return Err(RectifiedError::NotNext { frame, v });
        };
        lines.read_ahead(&mut self.source, v, line).map_err(RectifiedError::Source)?;
        lines.resample(v, line);
        Ok(())
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), Self::Error> {
        self.source.read_prior(v, line).map_err(RectifiedError::Source)
    }
}

impl<S: Rewind> Rewind for Rectified<'_, S> {
    fn rewind(&mut self) -> Result<(), Self::Error> {
        self.source.rewind().map_err(RectifiedError::Source)?;
        self.frames.iter_mut().flatten().for_each(SourceLines::clear);
        Ok(())
    }
}

/// The reason why a line could not be rectified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RectifiedError<E> {
    /// The source of the lines to rectify failed.
    Source(E),
    /// The line is not the one below the last of the frame, is outside the frame, or the frame is not one of those that are
    /// rectified.
    NotNext {
        /// The frame.
        frame: Frame,
        /// The line.
        v: usize,
    },
    /// The slice for the line has the wrong length.
    LineLength {
        /// Pixels needed: the frame's width.
        needed: usize,
        /// Pixels given.
        given: usize,
    },
}

impl<E: fmt::Display> fmt::Display for RectifiedError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RectifiedError::Source(error) => error.fmt(f),
            RectifiedError::NotNext { frame, v } => write!(f, "line {v} of frame {frame} is not the next to be rectified"),
            RectifiedError::LineLength { needed, given } => write!(f, "a line has {needed} pixels, {given} were given"),
        }
    }
}

impl<E: error::Error> error::Error for RectifiedError<E> {}
