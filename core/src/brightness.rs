//! Views as bright as the centre: a table of grey values for each view, made of the histograms of both.
//!
//! Block matching compares grey values, so a change of exposure between the frames ruins it. A view shows nearly the scene of the
//! centre, so their grey values in order correspond (histogram specification: Gonzalez and Woods, "Digital Image Processing").

use crate::{Disparity, Frame, Rewind, ScanlineSource, View};

/// The number of grey values.
const GRAYS: usize = 256;

/// The number of pixels of each grey value in a frame.
///
/// ```
/// use multiscopic_core::Histogram;
///
/// let [mut center, mut dark] = [Histogram::new(), Histogram::new()];
/// center.count(&[20, 40, 40, 60, 200]);
/// dark.count(&[10, 20, 20, 30, 100]);
/// let table = dark.table_to(&center);
/// assert_eq!([10, 20, 30, 100].map(|gray: usize| table[gray]), [20, 40, 60, 200]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Histogram([u32; GRAYS]);

impl Default for Histogram {
    fn default() -> Histogram {
        Histogram::new()
    }
}

impl Histogram {
    /// No pixels yet.
    pub const fn new() -> Histogram {
        Histogram([0; GRAYS])
    }

    /// Counts the pixels of a line.
    pub fn count(&mut self, line: &[u8]) {
        for &gray in line {
            let count = &mut self.0[usize::from(gray)];
            *count = count.saturating_add(1);
        }
    }

    /// Returns the table from these grey values to those of `other`, in ascending order: the pixel in the middle of those of a
    /// grey value gets the grey value of the pixel at the same share of `other`'s in ascending order. Each value maps to itself
    /// if a histogram is empty.
    pub fn table_to(&self, other: &Histogram) -> [u8; GRAYS] {
        let [own_total, total] = [self, other].map(|histogram| histogram.0.iter().map(|&count| u64::from(count)).sum::<u64>());
        let mut table = [0; GRAYS];
        // The pixels below the grey value, and those of `other` up to and with the one that it maps to.
        let (mut below, mut target) = (0, 0_u8);
        let mut covered = u64::from(other.0[0]);
        for (gray, (entry, &count)) in (0..=u8::MAX).zip(table.iter_mut().zip(&self.0)) {
            let twice_middle = 2 * below + u64::from(count);
            below += u64::from(count);
            let rank = |total: u64| (u128::from(twice_middle) * u128::from(total)).checked_div(2 * u128::from(own_total));
            let Some(rank) = rank(total).filter(|_| total > 0) else {
                *entry = gray;
                continue;
            };
            while u128::from(covered) <= rank && covered < total {
                target = target.saturating_add(1);
                covered += u64::from(other.0[usize::from(target)]);
            }
            *entry = target;
        }
        table
    }
}

/// A source whose views are as bright as its centre: their pixels go through tables of grey values. A view without a table stays
/// as it is.
///
/// ```
/// use multiscopic_core::{Evened, Frame, Histogram, ScanlineSource, View};
///
/// /// A line of pixels, half as bright in the right view.
/// struct Lines;
///
/// impl ScanlineSource for Lines {
///     type Error = core::convert::Infallible;
///
///     fn read_line(&mut self, frame: Frame, _v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
///         let scale = if frame == Frame::Center { 2 } else { 1 };
///         line.iter_mut().zip(10..).for_each(|(pixel, gray)| *pixel = scale * gray);
///         Ok(())
///     }
/// }
///
/// let right = Frame::View(View::RIGHT);
/// let histograms = [Frame::Center, right].map(|frame| {
///     let (mut histogram, mut line) = (Histogram::new(), [0; 80]);
///     Lines.read_line(frame, 0, &mut line).unwrap();
///     histogram.count(&line);
///     histogram
/// });
/// let tables = [(View::RIGHT, histograms[1].table_to(&histograms[0]))];
/// let mut line = [0; 80];
/// Evened::new(Lines, &tables).read_line(right, 0, &mut line).unwrap();
/// assert_eq!(line[..3], [20, 22, 24]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Evened<'t, S> {
    source: S,
    tables: &'t [(View, [u8; GRAYS])],
}

impl<'t, S> Evened<'t, S> {
    /// The source, with tables for its views.
    pub const fn new(source: S, tables: &'t [(View, [u8; GRAYS])]) -> Evened<'t, S> {
        Evened { source, tables }
    }
}

impl<S: ScanlineSource> ScanlineSource for Evened<'_, S> {
    type Error = S::Error;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), S::Error> {
        self.source.read_line(frame, v, line)?;
        if let Some((_, table)) = self.tables.iter().find(|(view, _)| frame == Frame::View(*view)) {
            line.iter_mut().for_each(|pixel| *pixel = table[usize::from(*pixel)]);
        }
        Ok(())
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), S::Error> {
        self.source.read_prior(v, line)
    }
}

impl<S: Rewind> Rewind for Evened<'_, S> {
    fn rewind(&mut self) -> Result<(), S::Error> {
        self.source.rewind()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    /// The definition, by sorted pixels.
    fn sorted_table(own: &[u8], other: &[u8]) -> [u8; GRAYS] {
        let sorted = |pixels: &[u8]| {
            let mut pixels = Vec::from(pixels);
            pixels.sort_unstable();
            pixels
        };
        let (own, other) = (sorted(own), sorted(other));
        core::array::from_fn(|gray| {
            let [below, up_to] = [gray, gray + 1].map(|gray| own.partition_point(|pixel| usize::from(*pixel) < gray));
            let rank = (below + up_to) * other.len() / (2 * own.len());
            other[rank.min(other.len() - 1)]
        })
    }

    #[test]
    fn tables_are_those_of_sorted_pixels() {
        let mut state = 1_u32;
        let mut random = |most: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % most
        };
        for _ in 0..200 {
            let [own, other] = [0, 1].map(|_| {
                let (count, least, range) = (1 + random(300), random(200), 1 + random(56));
                (0..count).map(|_| (least + random(range)) as u8).collect::<Vec<u8>>()
            });
            let histogram = |pixels: &[u8]| {
                let mut histogram = Histogram::new();
                pixels.chunks(7).for_each(|line| histogram.count(line));
                histogram
            };
            assert_eq!(histogram(&own).table_to(&histogram(&other)), sorted_table(&own, &other), "{own:?} to {other:?}");
        }
        let identity: [u8; GRAYS] = core::array::from_fn(|gray| gray as u8);
        assert_eq!(Histogram::new().table_to(&Histogram::default()), identity);
    }
}
