//! Counting the pixels of a frame by how their costs are fused.

use std::ops::Range;

use multiscopic_core::{Params, View, kernel::Rule};

/// How many pixels are fused in which way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PixelCounts {
    /// All views are available at all disparities.
    pub(super) complete: usize,
    /// Some views are unavailable, and are masked.
    pub(super) masked: usize,
    /// Some views are unavailable, and costs are fused by segments.
    pub(super) segmented: usize,
    /// The segments of the segmented pixels.
    pub(super) segments: usize,
}

impl PixelCounts {
    /// Counts the pixels of a match from disparity `first` on, with a kernel that masks sums, or fuses them by segments.
    pub(super) fn new(params: &Params, first: i16, masks_sums: bool) -> PixelCounts {
        let places = params.views().places();
        let rule = Rule::new(params.fusion(), places);
        let all = 0..params.num_disparities() as u16;
        let mut counts = PixelCounts::default();
        for (u, v) in (0..params.height()).flat_map(|v| (0..params.width()).map(move |u| (u, v))) {
            let ranges = || params.views().iter().map(|view| available(params, first, view, u, v));
            // Places without a view are never available.
            match ranges().filter(|range| *range != all).count() + places - params.views().len() {
                0 => counts.complete += 1,
                _ if masks_sums && rule == Rule::Sum => counts.masked += 1,
                incomplete if rule.masks(places, incomplete) => counts.masked += 1,
                _ => {
                    counts.segmented += 1;
                    let mut cuts: Vec<u16> = ranges().flat_map(|range| [range.start, range.end]).collect();
                    cuts.extend([all.start, all.end]);
                    cuts.sort_unstable();
                    cuts.dedup();
                    counts.segments += cuts.len() - 1;
                }
            }
        }
        counts
    }
}

/// The disparities, counted from the first, at which a view is available at a pixel.
fn available(params: &Params, first: i16, view: View, u: usize, v: usize) -> Range<u16> {
    view.available((u, v), (params.width(), params.height()), first, params.num_disparities())
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, SearchConfig, Views};

    fn params(views: Views, fusion: Fusion, min_disparity: i16, num_disparities: u16, block_size: u8) -> Params {
        SearchConfig { width: 20, height: 17, views, fusion, min_disparity, num_disparities }.block_matching(block_size).unwrap()
    }

    /// The views available at `(u, v)` and `d`. States the definition again, independently of the core.
    fn available_views(params: &Params, u: usize, v: usize, d: i16) -> Vec<View> {
        let (u, v, d) = (u as i32, v as i32, i32::from(d));
        let is_available = |view: &View| {
            let (x, y) = match *view {
                View::RIGHT => (u - d, v),
                View::LEFT => (u + d, v),
                View::TOP => (u, v + d),
                View::BOTTOM => (u, v - d),
                view => (u - i32::from(view.right()) * d, v - i32::from(view.down()) * d),
            };
            (0..params.width() as i32).contains(&x) && (0..params.height() as i32).contains(&y)
        };
        params.views().iter().filter(is_available).collect()
    }

    #[test]
    fn counts_agree_with_the_definition_at_each_pixel() {
        let corner = View::new(-2, 1).unwrap();
        let sets = [Views::STEREO, Views::HORIZONTAL, Views::CROSS, Views::NONE.with(View::TOP), Views::STEREO.with(corner)];
        let searches = [(1, 4), (0, 9), (-3, 5), (-6, 3), (2, 40)];
        for (views, (min, num)) in sets.into_iter().flat_map(|views| searches.map(|search| (views, search))) {
            let mean = params(views, Fusion::Mean, min, num, 3);
            let (mut complete, mut border, mut segments) = (0, 0, 0);
            for (u, v) in (0..mean.height()).flat_map(|v| (0..mean.width()).map(move |u| (u, v))) {
                let mut runs: Vec<Vec<View>> = (min..=mean.max_disparity()).map(|d| available_views(&mean, u, v, d)).collect();
                runs.dedup();
                match runs.len() {
                    1 if runs[0].len() == views.len() => complete += 1,
                    runs => (border, segments) = (border + 1, segments + runs),
                }
            }
            let masked = PixelCounts { complete, masked: border, segmented: 0, segments: 0 };
            // With one view, every fusion is the minimum.
            let expected =
                if views.len() == 1 { masked } else { PixelCounts { complete, masked: 0, segmented: border, segments } };
            assert_eq!(PixelCounts::new(&mean, min, false), expected, "{mean:?}");
            assert_eq!(PixelCounts::new(&mean, min, true), masked);
            assert_eq!(PixelCounts::new(&params(views, Fusion::Min, min, num, 3), min, false), masked);
        }
        let heuristic = PixelCounts::new(&params(Views::CROSS, Fusion::Heuristic, 1, 12, 3), 1, true);
        assert!(heuristic.masked > 0 && heuristic.segmented > 0, "{heuristic:?}");
    }
}
