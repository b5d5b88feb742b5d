//! Replication beyond the borders of a line.

/// Fills `stored` with the samples of `line` from the coordinate `left` on. Beyond the line, its first and
/// last samples are repeated.
#[inline(always)]
pub(crate) fn replicate<'h>(mut stored: impl Iterator<Item = &'h mut u8>, line: &[u8], left: i32) {
    let (Some(&first), Some(&last)) = (line.first(), line.last()) else { return };
    stored.by_ref().take(left.min(0).unsigned_abs() as usize).for_each(|sample| *sample = first);
    let inside = line.get(left.max(0) as usize..).unwrap_or_default();
    // `zip` alone would take, and drop, one sample more than it fills.
    stored.by_ref().take(inside.len()).zip(inside).for_each(|(sample, &inside)| *sample = inside);
    stored.for_each(|sample| *sample = last);
}
