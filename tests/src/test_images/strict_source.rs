//! A source of scanlines that holds the matcher to its contract.

use multiscopic_core::{BlockMatchingParams, Frame, Region, ScanlineSource, SearchSpace, SemiGlobalParams, View};

use crate::test_images::view_set::{ViewSet, view_at};

/// The nearest frames: the centre, then the views in the order of [`ViewSet::views`].
pub const FRAMES: [Frame; 5] =
    [Frame::Center, Frame::View(View::LEFT), Frame::View(View::RIGHT), Frame::View(View::TOP), Frame::View(View::BOTTOM)];

/// A source that panics unless each line of each frame is requested once, in ascending order, and never
/// further ahead than [`BlockMatchingParams::lead`] or [`SemiGlobalParams::lead`] allows.
#[derive(Debug)]
pub struct StrictSource<'a> {
    images: &'a ViewSet,
    search: SearchSpace,
    region: Region,
    /// The frames, and how many lines past its own a disparity line needs of each.
    leads: Vec<(Frame, i32)>,
    /// The number of disparity lines produced so far.
    done: usize,
    /// The line expected next of each frame; `None` before the first.
    next: Vec<Option<usize>>,
}

impl<'a> StrictSource<'a> {
    /// A source for one pass over `region`.
    pub fn new(images: &'a ViewSet, params: &BlockMatchingParams, region: &Region) -> StrictSource<'a> {
        StrictSource::with_leads(images, params.search(), region, |frame| params.lead(frame))
    }

    /// A source for a pass of semi-global matching.
    pub fn semi_global(images: &'a ViewSet, params: &SemiGlobalParams) -> StrictSource<'a> {
        StrictSource::with_leads(images, params.search(), &Region::whole(params.search()), |frame| params.lead(frame))
    }

    fn with_leads(images: &'a ViewSet, search: &SearchSpace, region: &Region, lead: impl Fn(Frame) -> i32) -> StrictSource<'a> {
        let others = images.others.iter().map(|(offset, _)| Frame::View(view_at(*offset)));
        let leads: Vec<(Frame, i32)> = FRAMES.into_iter().chain(others).map(|frame| (frame, lead(frame))).collect();
        StrictSource { images, search: *search, region: *region, next: vec![None; leads.len()], leads, done: 0 }
    }

    /// Notes that another disparity line was produced.
    pub fn line_done(&mut self) {
        self.done += 1;
    }

    /// The number of disparity lines produced so far.
    pub fn lines_done(&self) -> usize {
        self.done
    }

    /// Panics unless every line that the region needs was read.
    pub fn assert_finished(&self) {
        assert_eq!(self.done, self.region.height(), "disparity lines of the region");
        for (&(frame, _), &next) in self.leads.iter().zip(&self.next) {
            let expected = self.image(frame).is_some().then(|| {
                let at_the_bottom = self.region.rows().end == self.search.height();
                if at_the_bottom { self.search.height() } else { self.furthest(frame) + 1 }
            });
            assert_eq!(next, expected, "lines of {frame:?} that were read");
        }
    }

    fn image(&self, frame: Frame) -> Option<&'a [u8]> {
        match frame {
            Frame::Center => Some(&self.images.center),
            Frame::View(view) => self.images.view(view),
        }
    }

    /// The first line of `frame` that the region needs.
    fn first(&self, frame: Frame) -> usize {
        let down = match frame {
            Frame::View(view) => i32::from(view.down()),
            Frame::Center => 0,
        };
        // The highest match is that at one end of the search.
        let shift = (-down * i32::from(self.search.min_disparity())).min(-down * i32::from(self.search.max_disparity()));
        let top = self.region.rows().start as i32;
        if top == 0 { 0 } else { self.inside(top - self.leads[0].1 + shift) }
    }

    /// The last line of `frame` that the next disparity line needs, or that the last one needed.
    fn furthest(&self, frame: Frame) -> usize {
        let v = self.region.rows().start + self.done.min(self.region.height() - 1);
        self.inside(v as i32 + self.leads[self.place(frame)].1)
    }

    fn place(&self, frame: Frame) -> usize {
        self.leads.iter().position(|&(other, _)| other == frame).expect("a frame")
    }

    fn inside(&self, v: i32) -> usize {
        v.clamp(0, self.search.height() as i32 - 1) as usize
    }
}

impl ScanlineSource for StrictSource<'_> {
    type Error = std::convert::Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        let Some(image) = self.image(frame) else { panic!("{frame:?} is not one of the views") };
        assert!(v < self.search.height(), "line {v} of {frame:?} is outside the frame");
        assert_eq!(line.len(), self.search.width(), "pixels in line {v} of {frame:?}");
        let index = self.place(frame);
        let expected = self.next[index].unwrap_or_else(|| self.first(frame));
        assert_eq!(v, expected, "the line of {frame:?} that comes next");
        let last_line = self.region.rows().start + self.done + 1 == self.search.height();
        assert!(last_line || v <= self.furthest(frame), "line {v} of {frame:?} is read with only {} lines out", self.done);
        self.next[index] = Some(v + 1);
        line.copy_from_slice(&image[v * line.len()..][..line.len()]);
        Ok(())
    }
}
