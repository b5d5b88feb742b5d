//! The margin of a search: disparities beyond its range, which tell what the range cuts off.

use multiscopic_core::{Disparity, SearchConfig, SearchSpace};

use crate::images::{DisparityMap, Raster};

/// Disparities that are searched beyond each end of the range.
///
/// A surface that the range cuts off gathers at its end, and looks sure there. With a margin it is found where it is, or gathers
/// at the end of the margin: nothing is known of such a pixel but that it is not in the range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SearchMargin(u16);

impl SearchMargin {
    /// No margin.
    pub const NONE: SearchMargin = SearchMargin(0);
    /// The default margin of the network. With two disparities, large blank surfaces far out of the range still look sure.
    pub const NETWORK: SearchMargin = SearchMargin(4);

    /// A margin of so many disparities at each end.
    pub const fn of(disparities: u16) -> SearchMargin {
        SearchMargin(disparities)
    }

    /// The disparities at each end.
    pub const fn disparities(self) -> u16 {
        self.0
    }

    /// The search with the margin, or without where it would go beyond what a [`Disparity`] can be.
    pub fn widened(self, search: &SearchSpace) -> SearchSpace {
        let config = search.config();
        let margin = i16::try_from(self.0).unwrap_or(i16::MAX);
        let min_disparity = config.min_disparity.saturating_sub(margin);
        let num_disparities = config.num_disparities.saturating_add(self.0.saturating_mul(2));
        SearchConfig { min_disparity, num_disparities, ..config }.checked().unwrap_or(*search)
    }

    /// Moves disparities in the margin to the nearest end of the range. The evidence for those that are more than half a pixel
    /// away becomes 0.
    pub fn cut(self, map: &mut DisparityMap, evidence: Option<&mut Raster<u8>>, range: &SearchSpace) {
        let [Some(least), Some(most)] = [range.min_disparity(), range.max_disparity()].map(Disparity::whole) else { return };
        let mut evidence = evidence.map(|evidence| evidence.pixels_mut().iter_mut());
        for pixel in map.pixels_mut() {
            let evidence = evidence.as_mut().and_then(Iterator::next);
            let Some(found) = *pixel else { continue };
            let kept = found.clamp(least, most);
            *pixel = Some(kept);
            if i32::from(found.to_bits()).abs_diff(kept.to_bits().into()) > Disparity::STEPS as u32 / 2
                && let Some(evidence) = evidence
            {
                *evidence = 0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use multiscopic_core::Views;

    use super::*;

    #[test]
    fn disparities_beyond_the_range_go_to_its_ends() {
        let search = SearchConfig { views: Views::STEREO, min_disparity: 2, num_disparities: 3, ..SearchConfig::of_size(6, 1) };
        let search = search.checked().unwrap();
        let margin = SearchMargin::of(4);
        let wide = margin.widened(&search);
        assert_eq!([wide.min_disparity(), wide.max_disparity()], [-2, 8]);
        let bits = [Some(-128), Some(96), Some(95), Some(200), Some(289), None];
        let mut map = DisparityMap::new(6, 1, bits.map(|bits| bits.and_then(Disparity::from_bits)).to_vec());
        let mut evidence = Raster::filled(6, 1, 9);
        margin.cut(&mut map, Some(&mut evidence), &search);
        assert_eq!(
            map.pixels(),
            [128, 128, 128, 200, 256].map(Disparity::from_bits).into_iter().chain([None]).collect::<Vec<_>>()
        );
        assert_eq!(evidence.pixels(), [0, 9, 0, 9, 0, 9]);
    }

    #[test]
    fn a_margin_that_does_not_fit_is_left_out() {
        let search = SearchConfig { min_disparity: -500, ..SearchConfig::of_size(60, 40) }.checked().unwrap();
        assert_eq!(SearchMargin::of(100).widened(&search), search);
    }
}
