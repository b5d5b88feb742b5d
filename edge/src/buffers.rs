//! The memory of the pipeline, sized at compile time.

use multiscopic_core::{Disparity, Memory, kernel::Portable};

/// The portable twin of the kernels for Arm: as many lanes, so the same memory layout, on any processor.
pub type Wide = Portable<8>;

/// The lengths of the buffers of a [`Workspace`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lengths {
    /// The matcher's memory by buffer, or that of both matchers from short baselines to long ones.
    pub matcher: Memory,
    /// Bytes of the [lines](multiscopic_core::ConfidenceLines) that confidences are computed from, and of a line of them, in
    /// whole words; 0 without confidences.
    pub confidence: usize,
    /// Disparities of a line.
    pub columns: usize,
    /// Bytes of the buffer that packets are encoded in.
    pub packet: usize,
}

impl Lengths {
    /// The size of the workspace in bytes.
    pub const fn bytes(&self) -> usize {
        (4 * self.words() + self.line_bytes() + self.packet).next_multiple_of(align_of::<u32>())
    }

    /// The words of the matcher and of the confidences.
    pub const fn words(&self) -> usize {
        self.matcher.words() + self.confidence / size_of::<u32>()
    }

    /// The size of a disparity line in bytes.
    pub const fn line_bytes(&self) -> usize {
        self.columns * size_of::<Option<Disparity>>()
    }
}

/// The memory of a [`Pipeline`](crate::Pipeline).
///
/// ```
/// use std::sync::Mutex;
/// use multiscopic_edge::{Wide, Workspace, profile::QQVGA, workspace};
///
/// // In firmware, a `static_cell::ConstStaticCell` that is taken once.
/// static WORKSPACE: Mutex<workspace!(Wide, QQVGA)> = Mutex::new(Workspace::new());
///
/// let mut workspace = WORKSPACE.lock().unwrap();
/// let pipeline = workspace.pipeline();
/// ```
///
/// `WORDS` are for the matcher and the confidences, `COLUMNS` for a line of disparities, and `PACKET` bytes to encode it in. They
/// come from [`Lengths`]; [`workspace!`](crate::workspace) is the type for a profile.
// In this order in memory, so that a debugger finds each part.
#[repr(C)]
pub struct Workspace<const WORDS: usize, const COLUMNS: usize, const PACKET: usize> {
    pub(crate) words: [u32; WORDS],
    pub(crate) line: [Option<Disparity>; COLUMNS],
    pub(crate) packet: [u8; PACKET],
}

impl<const WORDS: usize, const COLUMNS: usize, const PACKET: usize> Workspace<WORDS, COLUMNS, PACKET> {
    /// An empty workspace, to initialise a static with.
    #[expect(clippy::new_without_default, reason = "a static needs a const fn, and a default would be made on the stack")]
    pub const fn new() -> Self {
        Workspace { words: [0; WORDS], line: [None; COLUMNS], packet: [0; PACKET] }
    }
}

/// The type of the [`Workspace`] that a kernel needs for a [`Profile`](crate::Profile).
#[macro_export]
macro_rules! workspace {
    ($kernel:ty, $profile:path) => {
        $crate::Workspace<
            { $profile.lengths::<$kernel>().words() },
            { $profile.lengths::<$kernel>().columns },
            { $profile.lengths::<$kernel>().packet },
        >
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Matching, profile};

    #[test]
    fn lengths_predict_the_size_of_the_static() {
        let sizes = [
            size_of::<workspace!(Wide, profile::QQVGA)>(),
            size_of::<workspace!(Wide, profile::QVGA)>(),
            size_of::<workspace!(Wide, profile::QVGA_TILED)>(),
            size_of::<workspace!(Wide, profile::VGA)>(),
            size_of::<workspace!(Wide, profile::VGA_TILED)>(),
            size_of::<workspace!(Wide, profile::QQVGA_SGM)>(),
            size_of::<workspace!(Wide, profile::QVGA_SGM)>(),
            size_of::<workspace!(Wide, profile::QQVGA_3X3)>(),
            size_of::<workspace!(Wide, profile::QVGA_PRIOR)>(),
            size_of::<workspace!(Wide, profile::QVGA_CONFIDENCE)>(),
            size_of::<workspace!(Wide, profile::QQVGA_SGM_CONFIDENCE)>(),
            size_of::<workspace!(Wide, profile::QQVGA_NET)>(),
        ];
        assert_eq!(sizes, profile::ALL.map(|profile| profile.lengths::<Wide>().bytes()));
    }

    #[test]
    fn lengths_are_rounded_up_to_words() {
        const ODD: Lengths = match profile::QQVGA.matching(multiscopic_core::Fusion::Min) {
            Matching::Blocks { params, .. } => Matching::Blocks { params, tile_width: 23 },
            other => other,
        }
        .lengths::<Wide>();
        type Odd = Workspace<{ ODD.words() }, { ODD.columns }, { ODD.packet }>;
        assert_eq!(size_of::<Odd>(), ODD.bytes());
    }
}
