//! Frames go on beyond their borders by replication.

/// Fills `held` with the samples of `line` from the coordinate `left` on. Where that is outside the line, the first and the last sample are
/// repeated.
#[inline(always)]
pub(super) fn replicate<'h>(mut held: impl Iterator<Item = &'h mut u8>, line: &[u8], left: i32) {
    let (Some(&first), Some(&last)) = (line.first(), line.last()) else { return };
    held.by_ref().take(left.min(0).unsigned_abs() as usize).for_each(|sample| *sample = first);
    let inside = line.get(left.max(0) as usize..).unwrap_or_default();
    // `zip` alone would take, and drop, one sample more than it fills.
    held.by_ref().take(inside.len()).zip(inside).for_each(|(sample, &inside)| *sample = inside);
    held.for_each(|sample| *sample = last);
}
