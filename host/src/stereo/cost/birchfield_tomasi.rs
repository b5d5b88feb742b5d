//! The dissimilarity of pixels by Birchfield and Tomasi, which sampling does not sway.
//!
//! It is the improved form of Kolmogorov and Zabih that the paper uses (eq. 3 and 4): an image takes at a pixel every value between the
//! least and the greatest of the pixel itself and the points half way to its four neighbours. A value is as far from a pixel of the
//! other image as from that interval; of both directions the smaller distance counts (Birchfield and Tomasi, A pixel dissimilarity
//! measure that is insensitive to image sampling, 1998).

use std::ops::Range;

use image::{GrayImage, RgbImage};
use multiscopic_core::View;

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

/// The columns of row `v` of an image of a size whose matches at disparity `d` lie inside, and the index of the first of these matches; `None`
/// if there are no such columns.
pub fn matches_inside([width, height]: [usize; 2], view: View, v: usize, d: i16) -> Option<(Range<usize>, usize)> {
    let shift = view.sign() as isize * isize::from(d);
    let (along, across) = if view.is_horizontal() { (shift, 0) } else { (0, shift) };
    let row = v.checked_add_signed(across).filter(|row| *row < height)?;
    let inside = |column: isize| column.clamp(0, width as isize) as usize;
    let columns = inside(-along)..inside(width as isize - along);
    (!columns.is_empty()).then(|| (columns.clone(), row * width + columns.start.wrapping_add_signed(along)))
}

impl Intervals {
    /// The costs are whole numbers of this part of an intensity, for every channel.
    pub const STEPS: i32 = 2;
    /// The cost where a pixel has no match inside the image.
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

    /// How many channels it has.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    /// The costs of the pixels of row `v` of this image, the centre, with their matches in `other`, a view, at disparity `d`: the sum
    /// over the channels, at most 1530, and [`NONE`](Intervals::NONE) where the match lies outside.
    ///
    /// # Panics
    /// If the images differ in size or channels, or `costs` is not a row.
    pub fn row_costs(&self, other: &Intervals, view: View, v: usize, d: i16, costs: &mut [i16]) {
        self.assert_like(other);
        assert_eq!(costs.len(), self.width, "a row of costs");
        let Some((columns, first)) = matches_inside([self.width, self.height], view, v, d) else {
            return costs.fill(Intervals::NONE);
        };
        costs[..columns.start].fill(Intervals::NONE);
        costs[columns.end..].fill(Intervals::NONE);
        self.span_costs(other, v * self.width + columns.start, first, &mut costs[columns]);
    }

    /// The costs of row `v`, from `margin` columns before the image to as many after it, where the image and `other` are extended beyond
    /// their borders by replication; the row may lie outside too.
    ///
    /// # Panics
    /// If the images differ in size or channels, or `costs` is not a row and its margins.
    pub fn extended_row_costs(&self, other: &Intervals, view: View, v: isize, d: i16, margin: usize, costs: &mut [i16]) {
        let (width, height, shift) = (self.width as isize, self.height as isize, view.sign() as isize * isize::from(d));
        self.assert_like(other);
        assert_eq!(costs.len(), self.width + 2 * margin, "a row of costs");
        let (across, along) = if view.is_horizontal() { (shift, 0) } else { (0, shift) };
        let inside = |place: isize, size: isize| place.clamp(0, size - 1);
        let [here, there] = [v, v + along].map(|v| inside(v, height) * width);
        // Pixels that lie inside as their matches do, and what is left of them and right.
        let first = |column: isize| (column + margin as isize).clamp(0, costs.len() as isize) as usize;
        let (start, end) = (first(0.max(-across)), first(width.min(width - across)));
        let end = end.max(start);
        for i in (0..start).chain(end..costs.len()) {
            let u = i as isize - margin as isize;
            let (p, q) = (here + inside(u, width), there + inside(u + across, width));
            self.span_costs(other, p as usize, q as usize, &mut costs[i..=i]);
        }
        if start < end {
            let u = start as isize - margin as isize;
            self.span_costs(other, (here + u) as usize, (there + u + across) as usize, &mut costs[start..end]);
        }
    }

    fn assert_like(&self, other: &Intervals) {
        let [found, expected] = [other, self].map(|image| (image.width, image.height, image.channels.len()));
        assert_eq!(found, expected, "images of one kind");
    }

    /// The costs of pixels side by side, by their places among all: from `here` on with those of `other` from `there` on.
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

/// How far a value is from an interval.
#[inline(always)]
fn distance(value: i16, least: i16, greatest: i16) -> i16 {
    (least - value).max(value - greatest).max(0)
}
