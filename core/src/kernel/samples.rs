//! The samples of a line.

/// The samples that a line of the centre is compared with at all disparities, column by column. A column's
/// are contiguous, at ascending disparities.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Samples<'a> {
    /// The memory that holds them.
    pub memory: &'a [u8],
    /// The beginning of the first column.
    pub start: usize,
    /// From the beginning of a column to that of the next.
    pub step: isize,
    /// Samples in a column.
    pub depth: usize,
}

impl<'a> Samples<'a> {
    /// The samples of a column.
    #[inline(always)]
    pub fn column(&self, u: usize) -> &'a [u8] {
        let start = self.start.wrapping_add_signed(u as isize * self.step);
        self.memory.get(start..start + self.depth).unwrap_or_default()
    }

    /// The beginning of the first column, if the memory holds all the samples of `columns` columns.
    pub fn first(&self, columns: usize) -> Option<*const u8> {
        let last = self.step.checked_mul(columns.checked_sub(1)? as isize)?;
        let last = self.start.checked_add_signed(last)?;
        let covered = |start: usize| start.checked_add(self.depth).is_some_and(|end| end <= self.memory.len());
        (covered(self.start) && covered(last)).then(|| self.memory.as_ptr().wrapping_add(self.start))
    }
}
