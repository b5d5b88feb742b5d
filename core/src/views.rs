//! Sets of views.

use core::fmt;

use crate::{View, view::greatest_common_divisor};

/// A set of neighbouring views, at most [`Views::MAX`].
///
/// Views have one order, whatever order they were added in: those of [`View::CROSS`] come in theirs.
///
/// ```
/// use multiscopic_core::{View, Views};
/// const PAIR: Views = Views::NONE.with(View::RIGHT).with(View::LEFT);
/// assert_eq!(PAIR.len(), 2);
/// assert!(PAIR.iter().eq([View::LEFT, View::RIGHT]));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Views {
    /// The views, and any one view past the last.
    views: [View; Views::MAX],
    len: u8,
}

impl Views {
    /// The most views in a set: all others of an array of three by three, or with the feature `array` of five by five.
    pub const MAX: usize = if cfg!(feature = "array") { 24 } else { 8 };
    /// The most views that the matchers of this crate take: four, or with the feature `array` all others of an array of
    /// three by three. A program that does not know its views when it is compiled has code for each number of them.
    pub const MAX_MATCHED: usize = if cfg!(feature = "array") { 8 } else { 4 };

    /// No view.
    pub const NONE: Views = Views { views: [View::LEFT; Views::MAX], len: 0 };
    /// The classic stereo pair: centre and right.
    pub const STEREO: Views = Views::NONE.with(View::RIGHT);
    /// Left and right.
    pub const HORIZONTAL: Views = Views::STEREO.with(View::LEFT);
    /// Left, right and top.
    pub const THREE: Views = Views::HORIZONTAL.with(View::TOP);
    /// The four nearest neighbours.
    pub const CROSS: Views = Views::THREE.with(View::BOTTOM);
    /// All eight neighbours in an array of three by three.
    pub const ARRAY: Views = {
        let mut views = Views::CROSS;
        let mut corner = 0;
        while corner < 4 {
            if let Ok(view) = View::new([-1, 1, -1, 1][corner], [-1, -1, 1, 1][corner]) {
                views = views.with(view);
            }
            corner += 1;
        }
        views
    };

    /// This set with `view` added. A set of [`MAX`](Views::MAX) views takes no more.
    pub const fn with(self, view: View) -> Views {
        if self.contains(view) || self.len() == Views::MAX {
            return self;
        }
        let mut views = self.views;
        let (mut added, mut k) = (view, 0);
        while k < Views::MAX {
            if k >= self.len() {
                views[k] = added;
                break;
            }
            if added.rank() < views[k].rank() {
                (views[k], added) = (added, views[k]);
            }
            k += 1;
        }
        Views { views, len: self.len + 1 }
    }

    /// True if `view` is in the set.
    pub const fn contains(self, view: View) -> bool {
        let mut k = 0;
        while k < Views::MAX && k < self.len() {
            if self.views[k].rank() == view.rank() {
                return true;
            }
            k += 1;
        }
        false
    }

    /// The number of views in the set.
    pub const fn len(self) -> usize {
        self.len as usize
    }

    /// True if the set is empty.
    pub const fn is_empty(self) -> bool {
        self.len == 0
    }

    /// The `k`-th view.
    pub const fn get(self, k: usize) -> Option<View> {
        if k < Views::MAX && k < self.len() { Some(self.views[k]) } else { None }
    }

    /// The most baselines that the offsets of all views are whole multiples of; 0 for no view.
    pub const fn multiple(self) -> u8 {
        let (mut multiple, mut k) = (0, 0);
        while let Some(view) = self.get(k) {
            multiple = greatest_common_divisor(multiple, view.multiple());
            k += 1;
        }
        multiple
    }

    /// The views in the same directions at their distances divided by `divisor`, without those for which they are not
    /// whole.
    pub const fn divided_by(self, divisor: u8) -> Views {
        let (mut divided, mut k) = (Views::NONE, 0);
        while let Some(view) = self.get(k) {
            if let Some(view) = view.divided_by(divisor) {
                divided = divided.with(view);
            }
            k += 1;
        }
        divided
    }

    /// The views in the same directions at `multiple` times their distances, or `None` if one is out of range.
    pub const fn times(self, multiple: u8) -> Option<Views> {
        let (mut scaled, mut k) = (Views::NONE, 0);
        while let Some(view) = self.get(k) {
            match view.times(multiple) {
                Some(view) => scaled = scaled.with(view),
                None => return None,
            }
            k += 1;
        }
        Some(scaled)
    }

    /// The views that the matchers' loops go over: eight for five and more, of which those past the last are never
    /// available.
    pub const fn places(self) -> usize {
        if self.len() > 4 { 8 } else { self.len() }
    }

    /// The views in the set, in order.
    pub fn iter(self) -> impl Iterator<Item = View> {
        self.views.into_iter().take(self.len())
    }
}

impl Default for Views {
    fn default() -> Views {
        Views::NONE
    }
}

impl fmt::Debug for Views {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Views {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{}", self.views.get(..self.len()).unwrap_or_default());
    }
}

impl FromIterator<View> for Views {
    fn from_iter<I: IntoIterator<Item = View>>(views: I) -> Views {
        views.into_iter().fold(Views::NONE, Views::with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_array_has_all_neighbours() {
        let offsets = (-1..=1).flat_map(|down| (-1..=1).map(move |right| (right, down)));
        let mut neighbours = offsets.filter(|&offset| offset != (0, 0)).map(|(right, down)| View::new(right, down).unwrap());
        assert!(neighbours.all(|view| Views::ARRAY.contains(view)));
        assert_eq!(Views::ARRAY.len(), 8);
    }
}
