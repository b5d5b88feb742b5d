//! Operations of the standard library and of `bytemuck` that panic for some input, as they are where they do not: at low levels
//! of optimisation, the compiler does not see that no such input comes.

use bytemuck::{NoUninit, Pod};
use core::iter;

/// `dividend / divisor`, rounded up; 0 if the divisor is 0.
#[inline(always)]
pub(crate) const fn div_ceil(dividend: usize, divisor: usize) -> usize {
    match dividend.checked_div(divisor) {
        Some(quotient) if quotient * divisor < dividend => quotient + 1,
        Some(quotient) => quotient,
        None => 0,
    }
}

/// The parts of `length` elements, without what is left over at the end.
#[inline(always)]
pub(crate) fn parts<T>(mut slice: &[T], length: usize) -> impl Iterator<Item = &[T]> {
    iter::from_fn(move || {
        let part;
        (part, slice) = slice.split_at_checked(length)?;
        Some(part)
    })
}

/// [`parts`] of memory that changes.
#[cfg(feature = "network")]
#[inline(always)]
pub(crate) fn parts_mut<T>(mut slice: &mut [T], length: usize) -> impl Iterator<Item = &mut [T]> {
    iter::from_fn(move || {
        let part;
        (part, slice) = core::mem::take(&mut slice).split_at_mut_checked(length)?;
        Some(part)
    })
}

/// The same memory as elements of another type; none if it is no whole number of them.
#[inline(always)]
pub(crate) fn cast<T: NoUninit, U: Pod>(slice: &[T]) -> &[U] {
    bytemuck::try_cast_slice(slice).unwrap_or_default()
}

/// [`cast`] of memory that changes.
#[inline(always)]
pub(crate) fn cast_mut<T: Pod, U: Pod>(slice: &mut [T]) -> &mut [U] {
    bytemuck::try_cast_slice_mut(slice).unwrap_or_default()
}
