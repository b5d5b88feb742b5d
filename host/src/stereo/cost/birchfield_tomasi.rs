//! The pixel dissimilarity of Birchfield and Tomasi, which is insensitive to image sampling.
//!
//! This is the variant of Kolmogorov and Zabih that the paper uses (eq. 3 and 4). At a pixel, an image takes
//! every value between the least and the greatest of the pixel itself and the points half way to its four
//! neighbours. The cost of a match is the distance from a pixel's value to the interval of its match, or the
//! other way round, whichever is less (Birchfield and Tomasi, "A pixel dissimilarity measure that is
//! insensitive to image sampling", 1998). Channels of colour are summed.

use image::{GrayImage, RgbImage};
use multiscopic_core::{Frame, SearchSpace, View};

use super::{Cost, CostRows, RowMatches, fused_cost};
use crate::images::Frames;

/// The matching cost of grey values or colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BirchfieldTomasi {
    /// True to match colours instead of grey values, where all frames have them.
    pub color: bool,
}

impl BirchfieldTomasi {
    /// Returns true if the colours of `frames` are matched.
    pub fn matches_color(self, frames: &Frames) -> bool {
        self.color && frames.color(Frame::Center).is_some()
    }

    /// The intervals of a frame of `frames`.
    ///
    /// # Panics
    /// If the frame is missing.
    pub fn intervals(self, frames: &Frames, frame: Frame) -> Intervals {
        match frames.color(frame).filter(|_| self.color) {
            Some(color) => Intervals::of_rgb(color),
            None => Intervals::of_gray(frames.get(frame).expect("the search's views are there")),
        }
    }

    /// The fused costs of `frames`, in halves of an intensity.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn rows<'a>(self, frames: &Frames, search: &'a SearchSpace) -> BirchfieldTomasiRows<'a> {
        let views = search.views().iter().map(|view| (view, self.intervals(frames, Frame::View(view)))).collect();
        BirchfieldTomasiRows { search, center: self.intervals(frames, Frame::Center), views }
    }
}

/// The fused costs of a centre and its views, in halves of an intensity.
#[derive(Clone, Debug)]
pub struct BirchfieldTomasiRows<'a> {
    search: &'a SearchSpace,
    center: Intervals,
    views: Vec<(View, Intervals)>,
}

impl CostRows for BirchfieldTomasiRows<'_> {
    type Cost = u32;

    fn search(&self) -> &SearchSpace {
        self.search
    }

    fn row(&self, v: usize, stride: usize, row: &mut [u32]) {
        row.fill(u32::NONE);
        let mut views = vec![vec![Intervals::NONE; self.search.width()]; self.views.len()];
        for (index, d) in (self.search.min_disparity()..=self.search.max_disparity()).enumerate() {
            for ((view, intervals), costs) in self.views.iter().zip(&mut views) {
                self.center.row_costs(intervals, *view, v, d, costs);
            }
            for (u, pixel) in row.chunks_exact_mut(stride).enumerate() {
                let costs = views.iter().map(|view| if view[u] == Intervals::NONE { u32::NONE } else { view[u] as u32 });
                pixel[index] = fused_cost(self.search.fusion(), costs);
            }
        }
    }
}

/// An image, and the interval of values around each pixel.
#[derive(Clone, Debug)]
pub struct Intervals {
    width: usize,
    height: usize,
    /// One of grey, three of colour.
    channels: Vec<Channel>,
}

/// Values in steps of 1/2, so that the mean of two is whole; row by row.
#[derive(Clone, Debug)]
struct Channel {
    value: Vec<i16>,
    least: Vec<i16>,
    greatest: Vec<i16>,
}

impl Intervals {
    /// Units of cost in an intensity.
    pub const STEPS: i32 = 2;
    /// The greatest cost of a channel.
    pub const MAX_COST: u32 = 255 * Intervals::STEPS as u32;
    /// The cost of a pixel whose match lies outside the view.
    pub const NONE: i16 = i16::MAX;

    /// Of a grey image.
    pub fn of_gray(image: &GrayImage) -> Intervals {
        Intervals::new(image.width() as usize, image.height() as usize, image.as_raw(), 1)
    }

    /// Of an image in colour.
    pub fn of_rgb(image: &RgbImage) -> Intervals {
        Intervals::new(image.width() as usize, image.height() as usize, image.as_raw(), 3)
    }

    fn new(width: usize, height: usize, samples: &[u8], channels: usize) -> Intervals {
        let channel = |c: usize| Channel::new(width, height, samples.iter().skip(c).step_by(channels).copied());
        Intervals { width, height, channels: (0..channels).map(channel).collect() }
    }

    /// Returns the number of channels.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    /// The costs of the pixels of row `v` of this image, the centre, with their matches in `other`, a view,
    /// at disparity `d`: the sum over the channels, at most 1530, and [`NONE`](Intervals::NONE) where the
    /// match lies outside.
    ///
    /// # Panics
    /// If the images differ in size or channels, or `costs` is not a row.
    pub fn row_costs(&self, other: &Intervals, view: View, v: usize, d: i16, costs: &mut [i16]) {
        self.assert_like(other);
        assert_eq!(costs.len(), self.width, "a row of costs");
        let Some(RowMatches { columns, first }) = RowMatches::new([self.width, self.height], view, v, d) else {
            return costs.fill(Intervals::NONE);
        };
        costs[..columns.start].fill(Intervals::NONE);
        costs[columns.end..].fill(Intervals::NONE);
        self.span_costs(other, v * self.width + columns.start, first, &mut costs[columns]);
    }

    /// The costs of row `v`, from `margin` columns before the image to as many after it, where the image and
    /// `other` are extended beyond their borders by replication; the row may lie outside too.
    ///
    /// # Panics
    /// If the images differ in size or channels, or `costs` is not a row and its margins.
    pub fn extended_row_costs(&self, other: &Intervals, view: View, v: isize, d: i16, margin: usize, costs: &mut [i16]) {
        let (width, height) = (self.width as isize, self.height as isize);
        let (du, dv) = view.shift(d);
        let (du, dv) = (du as isize, dv as isize);
        self.assert_like(other);
        assert_eq!(costs.len(), self.width + 2 * margin, "a row of costs");
        let clamp = |place: isize, size: isize| place.clamp(0, size - 1);
        let [here, there] = [v, v + dv].map(|v| clamp(v, height) * width);
        // In the middle, pixels and matches both lie inside: these go as one span. The rest is clamped one by
        // one.
        let place = |column: isize| (column + margin as isize).clamp(0, costs.len() as isize) as usize;
        let (start, end) = (place(0.max(-du)), place(width.min(width - du)));
        let end = end.max(start);
        for i in (0..start).chain(end..costs.len()) {
            let u = i as isize - margin as isize;
            let (p, q) = (here + clamp(u, width), there + clamp(u + du, width));
            self.span_costs(other, p as usize, q as usize, &mut costs[i..=i]);
        }
        if start < end {
            let u = start as isize - margin as isize;
            self.span_costs(other, (here + u) as usize, (there + u + du) as usize, &mut costs[start..end]);
        }
    }

    fn assert_like(&self, other: &Intervals) {
        let [found, expected] = [other, self].map(|image| (image.width, image.height, image.channels.len()));
        assert_eq!(found, expected, "images of one kind");
    }

    /// The costs of pixels side by side, by their places among all: from `here` on with those of `other` from
    /// `there` on.
    #[inline(always)]
    fn span_costs(&self, other: &Intervals, here: usize, there: usize, costs: &mut [i16]) {
        costs.fill(0);
        let (here, there) = (here..here + costs.len(), there..there + costs.len());
        for (a, b) in self.channels.iter().zip(&other.channels) {
            let center = a.value[here.clone()].iter().zip(&a.least[here.clone()]).zip(&a.greatest[here.clone()]);
            let view = b.value[there.clone()].iter().zip(&b.least[there.clone()]).zip(&b.greatest[there.clone()]);
            for (cost, (((&p, &p_least), &p_greatest), ((&q, &q_least), &q_greatest))) in costs.iter_mut().zip(center.zip(view)) {
                *cost += distance(p, q_least, q_greatest).min(distance(q, p_least, p_greatest));
            }
        }
    }
}

impl Channel {
    fn new(width: usize, height: usize, samples: impl Iterator<Item = u8>) -> Channel {
        let samples: Vec<i16> = samples.map(i16::from).collect();
        let mut channel = Channel {
            value: samples.iter().map(|sample| 2 * sample).collect(),
            least: Vec::with_capacity(samples.len()),
            greatest: Vec::with_capacity(samples.len()),
        };
        for v in 0..height {
            for u in 0..width {
                let here = samples[v * width + u];
                let at = |u: usize, v: usize| here + samples[v.min(height - 1) * width + u.min(width - 1)];
                let half = [at(u, v), at(u.saturating_sub(1), v), at(u + 1, v), at(u, v.saturating_sub(1)), at(u, v + 1)];
                let (least, greatest) =
                    half.into_iter().fold((i16::MAX, 0), |(least, greatest), half| (half.min(least), half.max(greatest)));
                channel.least.push(least);
                channel.greatest.push(greatest);
            }
        }
        channel
    }
}

/// Returns the distance of a value from an interval.
#[inline(always)]
fn distance(value: i16, least: i16, greatest: i16) -> i16 {
    (least - value).max(value - greatest).max(0)
}
