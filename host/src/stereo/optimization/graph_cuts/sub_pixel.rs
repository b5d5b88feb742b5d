//! Disparities in fractions of a pixel: around the labels, and from matching in enlarged images.
//!
//! Those around the labels are not found by the energy's own costs: the dissimilarity of Birchfield and Tomasi is flat around
//! its minimum by design. Its sum over a window is not, because some pixels of a window are far enough from
//! their matches. Windows of 7 x 7 pixels were the best on the data sets, better than absolute differences in
//! windows of any size up to 11 x 11.
//!
//! The whole disparities of enlarged images are fractions of a pixel of the original images.

use std::cmp::Ordering;

use image::ImageBuffer;
use multiscopic_core::{Disparity, Frame, Fusion, SearchConfig, SearchSpace};
use rayon::prelude::*;

use super::{
    energy::Energy,
    parameters::{Label, OCCLUDED},
};
use crate::{
    error::{Error, Result},
    images::{DisparityMap, Frames, Picture},
    stereo::cost::{RowMatches, birchfield_tomasi::Intervals, fused_cost},
};

/// The pixels on each side of the window's centre.
const RADIUS: usize = 3;
/// The side of the window in pixels.
const SIDE: usize = 2 * RADIUS + 1;
/// The rows that a thread refines at a time.
const BAND_ROWS: usize = 32;
/// The cost of a disparity at which no view sees the match.
const NONE: u32 = u32::MAX;
// `Disparity::refine` takes costs below this bound.
const _: () = assert!(SIDE * SIDE * 255 * 3 * Intervals::STEPS as usize * 12 < 1 << 21);

/// The disparity of every pixel: its label, moved to the vertex of the parabola through the costs at the
/// label and its two neighbours. If one of these costs less than the label itself, the disparity moves by
/// half a pixel towards the cheaper one.
///
/// The cost in a view is the sum over the window, with images extended beyond their borders by replication. A
/// view counts if it sees the match of the pixel itself. A label is not moved if one of its neighbours is
/// outside `range[0]..=range[1]`, or if no view sees one of the three matches. Occluded pixels have no
/// disparity.
pub fn disparities(energy: &Energy, labels: &[Label], range: [Label; 2]) -> Vec<Option<Disparity>> {
    let [width, _] = energy.size();
    let mut refined: Vec<Option<Disparity>> = labels.iter().map(|&label| whole(label)).collect();
    refined.par_chunks_mut(BAND_ROWS * width).zip(labels.par_chunks(BAND_ROWS * width)).enumerate().for_each(
        |(i, (refined, labels))| {
            refine_band(energy, i * BAND_ROWS, labels, range, refined);
        },
    );
    refined
}

/// The whole disparity of a label. Occluded pixels have none.
pub fn whole(label: Label) -> Option<Disparity> {
    if label == OCCLUDED { None } else { Disparity::whole(label) }
}

/// Refines the rows from `top` on, which have `labels`. It goes through the disparities and skips those that
/// no label needs.
fn refine_band(energy: &Energy, top: usize, labels: &[Label], [least, most]: [Label; 2], refined: &mut [Option<Disparity>]) {
    let mut is_used = vec![false; usize::from(most.abs_diff(least)) + 1];
    let index = |label: Label| usize::from(label.abs_diff(least));
    labels.iter().filter(|label| (least..=most).contains(*label)).for_each(|&label| is_used[index(label)] = true);
    // The costs at three successive disparities.
    let mut costs = [const { Vec::new() }; 3];
    costs.iter_mut().for_each(|costs| costs.resize(labels.len(), NONE));
    let mut windows = WindowSums::new(energy, labels.len() / energy.size()[0]);
    for d in least..=most {
        let near = index(d).saturating_sub(1)..(index(d) + 2).min(is_used.len());
        if !is_used[near].contains(&true) {
            continue;
        }
        costs.rotate_left(1);
        windows.fused_costs(energy, top, d, &mut costs[2]);
        if d < least + 2 || !is_used[index(d - 1)] {
            continue;
        }
        let [before, at, after] = &costs;
        let around = before.iter().zip(at).zip(after);
        for (refined, (label, ((&before, &at), &after))) in refined.iter_mut().zip(labels.iter().zip(around)) {
            if *label == d - 1 && before != NONE && after != NONE {
                *refined = refine_label(d - 1, before, at, after);
            }
        }
    }
}

/// The disparity of a label with these costs before, at and after it.
fn refine_label(label: Label, before: u32, at: u32, after: u32) -> Option<Disparity> {
    if at <= before.min(after) {
        return Disparity::refine_wide(label, before.into(), at.into(), after.into());
    }
    let half = Disparity::STEPS / 2;
    let shift = match before.cmp(&after) {
        Ordering::Less => -half,
        Ordering::Equal => 0,
        Ordering::Greater => half,
    };
    Disparity::from_bits((i32::from(label) * Disparity::STEPS + shift) as i16)
}

/// Sums of costs over the windows around the pixels of some rows.
struct WindowSums {
    /// The costs of a row with its margins.
    row: Vec<i16>,
    /// Horizontal sums over [`SIDE`] pixels, for all rows and [`RADIUS`] rows before and after them.
    row_sums: Vec<i16>,
    /// Sums over windows, for each view.
    sums: Vec<Vec<u32>>,
}

impl WindowSums {
    fn new(energy: &Energy, rows: usize) -> WindowSums {
        let [width, _] = energy.size();
        WindowSums {
            row: vec![0; width + 2 * RADIUS],
            row_sums: vec![0; width * (rows + 2 * RADIUS)],
            sums: vec![vec![0; width * rows]; energy.views().count()],
        }
    }

    /// Computes the fused costs of the rows from `top` on at `d`. They are [`NONE`] where no view sees the
    /// match.
    fn fused_costs(&mut self, energy: &Energy, top: usize, d: Label, fused: &mut [u32]) {
        let WindowSums { row, row_sums, sums } = self;
        let [width, height] = energy.size();
        for ((view, image), sums) in energy.views().zip(sums.iter_mut()) {
            for (v, row_sums) in (top as isize - RADIUS as isize..).zip(row_sums.chunks_exact_mut(width)) {
                energy.center().extended_row_costs(image, view, v, d, RADIUS, row);
                for (u, sum) in row_sums.iter_mut().enumerate() {
                    *sum = row[u..u + SIDE].iter().sum();
                }
            }
            for (v, sums) in sums.chunks_exact_mut(width).enumerate() {
                let columns = RowMatches::new([width, height], view, top + v, d).map_or(0..0, |matches| matches.columns);
                let (start, end) = (columns.start, columns.end);
                sums[..start].fill(NONE);
                sums[end..].fill(NONE);
                sums[start..end].fill(0);
                for row_sums in row_sums.chunks_exact(width).skip(v).take(SIDE) {
                    sums[start..end].iter_mut().zip(&row_sums[start..end]).for_each(|(sum, &row_sums)| *sum += row_sums as u32);
                }
            }
        }
        if energy.fusion() == Fusion::Min {
            // The most common rule, written so that it vectorises.
            fused.fill(NONE);
            for sums in sums.iter() {
                fused.iter_mut().zip(sums).for_each(|(fused, &sum)| *fused = sum.min(*fused));
            }
            return;
        }
        for (i, fused) in fused.iter_mut().enumerate() {
            *fused = fused_cost(energy.fusion(), sums.iter().map(|sums| sums[i]));
        }
    }
}

/// The frames that `search` needs, enlarged by the factor `times`.
pub fn enlarged_frames(frames: &Frames, search: &SearchSpace, times: u8) -> Frames {
    let picture = |frame| match frames.color(frame) {
        Some(color) => Picture::Rgb(enlarged_image(color, times)),
        None => Picture::Gray(enlarged_image(frames.get(frame).expect("the frames have every view of the search"), times)),
    };
    let center = Frames::of_picture(picture(Frame::Center));
    search.views().iter().fold(center, |frames, view| frames.with_picture(view, picture(Frame::View(view))))
}

/// An image enlarged by the factor `times`: linear interpolation between the centres of its pixels, rounded
/// to the nearest, halves up. Beyond its borders the image is extended by replication.
fn enlarged_image<P: image::Pixel<Subpixel = u8>>(image: &ImageBuffer<P, Vec<u8>>, times: u8) -> ImageBuffer<P, Vec<u8>> {
    let times = u32::from(times);
    // The pixels before and after a coordinate, and its distance to the first in steps of 1 / (2 * times)
    // pixels.
    let around = |coordinate: u32, size: u32| {
        let (parts, of) = (2 * coordinate as i32 + 1 - times as i32, 2 * times as i32);
        let first = parts.div_euclid(of);
        let inside = |pixel: i32| pixel.clamp(0, size as i32 - 1) as u32;
        ([inside(first), inside(first + 1)], parts.rem_euclid(of) as u32)
    };
    ImageBuffer::from_fn(times * image.width(), times * image.height(), |x, y| {
        let ([left, right], across) = around(x, image.width());
        let ([top, bottom], down) = around(y, image.height());
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(u, v)| image.get_pixel(u, v).channels());
        let of = 2 * times;
        let weights = [(of - across) * (of - down), across * (of - down), (of - across) * down, across * down];
        let mut pixel = *image.get_pixel(left, top);
        for (c, sample) in pixel.channels_mut().iter_mut().enumerate() {
            let sum: u32 = corners.iter().zip(weights).map(|(corner, weight)| u32::from(corner[c]) * weight).sum();
            *sample = ((sum + of * of / 2) / (of * of)) as u8;
        }
        pixel
    })
}

/// The search in frames enlarged by the factor `times`.
///
/// # Errors
/// [`Error::Usage`] if the enlarged frames or their disparities are too large.
pub fn enlarged_search(search: &SearchSpace, times: u8) -> Result<SearchSpace> {
    let factor = i32::from(times);
    let [width, height] = [search.width(), search.height()].map(|side| side * usize::from(times));
    let too_large = |found: String| Error::Usage(format!("images enlarged {times} times have {found}: enlarge less"));
    let side =
        |length: usize| u16::try_from(length).map_err(|_| too_large(format!("a side of {length} pixels, and 65535 is the most")));
    let [least, most] = [search.min_disparity(), search.max_disparity()].map(|d| i32::from(d) * factor);
    if least < i32::from(Disparity::MIN_SEARCH) || most > i32::from(Disparity::MAX_SEARCH) {
        return Err(too_large(format!("disparities {least}..={most}, and 511 is the most, either way")));
    }
    let (min_disparity, num_disparities) = (least as i16, (most - least + 1) as u16);
    let (width, height) = (side(width)?, side(height)?);
    let enlarged = SearchConfig { width, height, min_disparity, num_disparities, ..search.config() };
    Ok(enlarged.checked()?)
}

/// The map of frames enlarged by the factor `times`, reduced to their original size. Each pixel has the
/// median of its block of `times` x `times` disparities, of an even number the upper one, rounded to the
/// nearest step, halves away from zero. It is invalid if more than half of the block is.
pub fn reduced(map: &DisparityMap, times: u8) -> DisparityMap {
    let times = usize::from(times);
    let (width, height) = (map.width() / times, map.height() / times);
    let pixel = |i: usize| {
        let (left, top) = (i % width * times, i / width * times);
        let block = (top..top + times).flat_map(|v| &map.row(v)[left..left + times]);
        let mut block: Vec<Disparity> = block.copied().flatten().collect();
        if 2 * block.len() < times * times {
            return None;
        }
        let middle = block.len() / 2;
        let bits = f64::from(block.select_nth_unstable(middle).1.to_bits());
        Disparity::from_bits((bits / times as f64).round() as i16)
    };
    DisparityMap::new(width, height, (0..width * height).map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma};
    use multiscopic_core::Views;

    use super::*;

    #[test]
    fn interpolates_between_pixel_centres() {
        let row = GrayImage::from_raw(3, 1, vec![10, 30, 90]).unwrap();
        assert_eq!(enlarged_image(&row, 1), row);
        // Enlarged twice, samples lie a quarter of a pixel before and after the centres.
        assert_eq!(
            enlarged_image(&row, 2).rows().next().unwrap().map(|Luma([x])| *x).collect::<Vec<_>>(),
            [10, 15, 25, 45, 75, 90]
        );
        assert_eq!(enlarged_image(&row, 3).as_raw()[9..18], [10, 10, 17, 23, 30, 50, 70, 90, 90]);
        let column = GrayImage::from_raw(1, 2, vec![0, 100]).unwrap();
        assert_eq!(
            enlarged_image(&column, 4).as_raw().chunks(4).map(|row| row[3]).collect::<Vec<_>>(),
            [0, 0, 13, 38, 63, 88, 100, 100]
        );
    }

    #[test]
    fn reduces_blocks_to_their_medians() {
        let pixel = |bits: Option<i16>| bits.and_then(Disparity::from_bits);
        let map =
            DisparityMap::new(4, 2, [Some(64), Some(67), None, Some(-64), Some(200), None, None, Some(-67)].map(pixel).into());
        assert_eq!(reduced(&map, 2).pixels(), [Some(34), Some(-32)].map(pixel));
        let sparse = DisparityMap::new(2, 2, [Some(64), None, None, None].map(pixel).into());
        assert_eq!(reduced(&sparse, 2).pixels(), [None]);
    }

    #[test]
    fn refuses_frames_that_are_too_large() {
        let search = |width: u16, least: i16, count: u16| {
            SearchConfig {
                width,
                height: 10,
                views: Views::STEREO,
                fusion: Fusion::Min,
                min_disparity: least,
                num_disparities: count,
            }
            .checked()
            .unwrap()
        };
        let enlarged = enlarged_search(&search(100, -3, 8), 4).unwrap();
        assert_eq!(
            enlarged,
            SearchConfig {
                width: 400,
                height: 40,
                views: Views::STEREO,
                fusion: Fusion::Min,
                min_disparity: -12,
                num_disparities: 29
            }
            .checked()
            .unwrap()
        );
        let message = |search: SearchSpace, times: u8| enlarged_search(&search, times).unwrap_err().to_string();
        assert!(message(search(20000, 1, 9), 4).contains("a side of 80000 pixels"));
        assert!(message(search(100, 1, 200), 3).contains("disparities 3..=600"));
        assert!(enlarged_search(&search(100, 1, 170), 3).is_ok());
    }
}
