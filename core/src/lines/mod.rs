//! The lines of all frames under the blocks of a disparity line.
//!
//! ```text
//! for the next disparity line, whose blocks reach down to line v of the centre:
//!     for each frame, the centre first:
//!         while its next line <= v + lead:     // lead: how much lower than the centre's the lowest match lies
//!             read the line into a buffer, and store it where blocks expect it
//!         if v + lead is past the last line: repeat the last line
//!     around a prior: interpolate the samples at each pixel's own offset
//! at(v): a view of the stored samples: memory, start of the first column, step from a column to the next, depth
//! ```
//!
//! Each line of each frame is read exactly once and in order, so that a source may be a sensor or a serial port. A frame
//! is stored no longer than some block needs it: rings of `block_size + 1` lines, and stacks as tall as the search.
//!
//! They are stored so that a column's samples at ascending disparities are contiguous: a view in the centre's row of
//! the array by line, mirrored if matches move to the left; any other by column. Frames are extended beyond their
//! borders by replication: *virtual* lines below 0 repeat the first line, those past the end the last.
//!
//! | module | what it is |
//! | --- | --- |
//! | `storage` | rings of lines, as they are or with samples of its own for each column, and stacks of samples for each column |
//! | `warped_rows` | a ring of lines of the prior, and one with the samples of each column that its prior foretells |

mod storage;
mod warped_rows;

use core::iter;

use crate::{
    BlockMatchingParams, Frame, MatchError, Params, Region, ScanlineSource, View, Views, infallible,
    kernel::Samples,
    memory::{Shape, StackShape},
    params::prior_of,
};
pub(crate) use storage::replicate;
use storage::{Columns, Rows, SpreadRows};
pub(crate) use warped_rows::PriorLines;
use warped_rows::WarpedRows;

/// The stored lines of all frames of a match.
#[derive(Debug)]
pub(crate) struct Frames<'m> {
    pub center: Lines<'m>,
    /// One for each view of the match, in their order.
    pub views: [Option<Lines<'m>>; Views::MAX_MATCHED],
    /// Around which is searched.
    pub priors: Option<PriorLines<'m>>,
}

impl<'m> Frames<'m> {
    /// Reads the lines that blocks need to reach down to line `v` of the centre. `line` is a buffer for a
    /// line.
    pub fn read_ahead<S: ScanlineSource, P: Params<BlockMatchingParams>>(
        &mut self,
        source: &mut S,
        params: &P,
        line: &mut [u8],
        v: i32,
    ) -> Result<(), MatchError<S::Error>> {
        let params = params.get();
        // Around a prior, virtual lines are those nearest to them inside the frame.
        let v = if prior_of::<P, _>(self.priors.as_ref()).is_some() { v.min(params.height() as i32 - 1).max(0) } else { v };
        if let Some(priors) = prior_of::<P, _>(self.priors.as_mut()) {
            priors.read_ahead(source, v as usize)?;
        }
        for (frame, lines) in self.frames(params) {
            while let Some(row) = lines.needed_line(v) {
                source.read_line(frame, row, line).map_err(MatchError::Source)?;
                lines.take(v, line, params.width());
            }
            lines.extend(v);
        }
        if let Some(priors) = prior_of::<P, _>(self.priors.as_ref()) {
            self.views.iter_mut().flatten().for_each(|lines| lines.warp(v, priors.steps()));
        }
        Ok(())
    }

    /// Reads the lines that no block needs, so that every line of every frame is read once.
    pub fn read_rest<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        params: &BlockMatchingParams,
        line: &mut [u8],
    ) -> Result<(), MatchError<S::Error>> {
        for (frame, lines) in self.frames(params) {
            while let Some(row) = lines.unread_line() {
                source.read_line(frame, row, line).map_err(MatchError::Source)?;
                lines.skip();
            }
        }
        Ok(())
    }

    /// The frames and their lines, the centre first.
    fn frames(&mut self, params: &BlockMatchingParams) -> impl Iterator<Item = (Frame, &mut Lines<'m>)> {
        let views = params.views().iter().map(|view| params.frame(view)).zip(self.views.iter_mut().flatten());
        iter::once((Frame::Center, &mut self.center)).chain(views)
    }
}

/// The stored lines of one frame.
#[derive(Debug)]
pub(crate) struct Lines<'m> {
    store: Store<'m>,
    /// The frame's last line.
    last: i32,
    /// The next line of the frame to be read.
    next: i32,
    /// The lines below the centre's line at which the view's lowest match lies.
    lead: i32,
}

#[derive(Debug)]
enum Store<'m> {
    Rows(Rows<'m>),
    SpreadRows(SpreadRows<'m>),
    Columns(Columns<'m>),
    WarpedRows(WarpedRows<'m>),
}

impl<'m> Lines<'m> {
    /// No lines of `frame` yet, which is the centre or stands for one of the views of `params`. `samples`, of
    /// [`Shape::frame_bytes`] bytes for each plane, will store them. A plane has a byte of each pixel: its grey value, or
    /// one of its descriptor.
    pub fn new(frame: Frame, params: &BlockMatchingParams, region: &Region, shape: Shape, samples: &'m mut [u8]) -> Lines<'m> {
        let radius = params.radius() as i32;
        let last = params.height() as i32 - 1;
        let lead = params.lead_of(frame) - radius;
        let left = region.columns().start as i32 - radius;
        let top = region.rows().start as i32 - radius;
        let min_disparity = i32::from(params.min_disparity());
        let plane_bytes = shape.frame_bytes(frame);
        let rows = |samples: &'m mut [u8], depth, mirrored, shift| {
            let reach = shape.span + depth - 1;
            Store::Rows(Rows {
                samples,
                plane_bytes,
                span: shape.span,
                reach,
                count: shape.ring_lines,
                depth,
                mirrored,
                left: left + shift,
            })
        };
        let mut first_virtual = top;
        let store = match frame {
            Frame::Center => rows(samples, 1, false, 0),
            Frame::View(view) if let Some(prior) = params.prior() => {
                let reach = shape.warped_lines(view);
                first_virtual = top.max(0) + lead - (reach as i32 - 1);
                Store::WarpedRows(WarpedRows {
                    samples,
                    view,
                    prior,
                    span: shape.span,
                    count: shape.ring_lines,
                    depth: shape.depth,
                    left,
                    width: params.width(),
                    last,
                    reach,
                    min_disparity: params.min_disparity(),
                    next: top.max(0),
                })
            }
            Frame::View(View::LEFT) => rows(samples, shape.depth, false, min_disparity),
            // A mirrored line ends with the leftmost sample: the first column's match at the largest
            // disparity.
            Frame::View(View::RIGHT) => rows(samples, shape.depth, true, 1 - min_disparity - shape.depth as i32),
            Frame::View(view) if view.is_horizontal() => Store::SpreadRows(SpreadRows {
                samples,
                plane_bytes,
                span: shape.span,
                count: shape.ring_lines,
                depth: shape.depth,
                left: left + view.shift(params.min_disparity()).0,
                step: view.shift(1).0,
            }),
            Frame::View(view) => {
                let stacks = StackShape::new(&shape, view);
                first_virtual = top + lead - (stacks.sets * (params.num_disparities() - 1)) as i32;
                let (nearest, furthest) = (view.shift(params.min_disparity()), view.shift(params.max_disparity()));
                let leftmost = nearest.0.min(furthest.0);
                Store::Columns(Columns {
                    samples,
                    plane_bytes,
                    shape: stacks,
                    depth: shape.depth,
                    mirrored: view.down() > 0,
                    left: left + leftmost,
                    nearest: ((nearest.0 - leftmost) as usize, nearest.1),
                    first: first_virtual,
                    next: first_virtual,
                    shifted_lines: 0,
                })
            }
        };
        // Not `clamp`, here and below: it panics if the frame is empty, and the compiler cannot see that it
        // is not.
        let next = if region.rows().start == 0 { 0 } else { first_virtual.min(last).max(0) };
        Lines { store, last, next, lead }
    }

    /// The next line of the frame to read before blocks can reach down to line `v` of the centre, or `None`
    /// if no line is missing.
    pub fn needed_line(&self, v: i32) -> Option<usize> {
        (self.next <= (v + self.lead).min(self.last).max(0)).then_some(self.next as usize)
    }

    /// The first line of the frame that has not been read, or `None` after the last.
    pub fn unread_line(&self) -> Option<usize> {
        (self.next <= self.last).then_some(self.next as usize)
    }

    /// Skips the line that was [`unread_line`](Lines::unread_line).
    pub fn skip(&mut self) {
        self.next += 1;
    }

    /// Stores the line that was [`needed_line`](Lines::needed_line) for line `v` of the centre: one plane of `width` pixels
    /// after the other.
    pub fn take(&mut self, v: i32, line: &[u8], width: usize) {
        let planes = || infallible::parts(line, width);
        match &mut self.store {
            Store::Rows(rows) => rows.put(self.next, planes()),
            Store::SpreadRows(rows) => rows.put(self.next, planes()),
            Store::WarpedRows(rows) => rows.put(self.next, line),
            Store::Columns(columns) => {
                while columns.next <= v + self.lead && columns.next.min(self.last).max(0) == self.next {
                    columns.push(planes());
                }
            }
        }
        self.next += 1;
    }

    /// Extends the frame beyond its first or last line, as far as line `v` of the centre needs.
    pub fn extend(&mut self, v: i32) {
        if let Store::Columns(columns) = &mut self.store {
            while columns.next <= v + self.lead {
                columns.repeat();
            }
        }
    }

    /// Finds the samples of line `v` of the centre around its prior, which has these `steps`.
    pub fn warp(&mut self, v: i32, steps: &[i16]) {
        if let Store::WarpedRows(rows) = &mut self.store {
            rows.warp(v, steps);
        }
    }

    /// The samples that line `v` of the centre, which may be virtual, is compared with.
    pub fn at(&self, v: i32) -> Samples<'_> {
        self.plane_at(v, 0)
    }

    /// The samples of a plane that line `v` of the centre, which may be virtual, is compared with.
    pub fn plane_at(&self, v: i32, plane: usize) -> Samples<'_> {
        match &self.store {
            Store::Rows(rows) => rows.at(v.min(self.last).max(0), plane),
            Store::SpreadRows(rows) => rows.at(v.min(self.last).max(0), plane),
            Store::WarpedRows(rows) => rows.at(v.min(self.last).max(0)),
            Store::Columns(columns) => columns.at(v, plane),
        }
    }
}
