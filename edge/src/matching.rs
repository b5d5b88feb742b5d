//! The computation of a pipeline, and the memory that it takes, sized at compile time.

use core::marker::PhantomData;

use multiscopic_core::{
    BlockMatchingParams, ConfidenceLines, Disparity, Memory, Params, Region, SearchConfig, SearchSpace, SemiGlobalCost,
    SemiGlobalParams, SweepParams, Views,
    kernel::{Isa, Native},
    network::NetworkParams,
};

use crate::packet;

/// The computation of a pipeline: the parameters of a method.
///
/// As a constant, [`params!`](multiscopic_core::params) makes a type of it, with which a pipeline links that method alone:
///
/// ```
/// use multiscopic_core::{Fusion, params};
/// use multiscopic_edge::{Matching, Workspace, profile::QQVGA, workspace};
///
/// params!(Qqvga: Matching = Ok(QQVGA.matching(Fusion::Min)));
///
/// let workspace: workspace!(Qqvga::PARAMS) = Workspace::new();
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Matching {
    /// Block matching in column tiles.
    Blocks {
        /// Its parameters.
        params: BlockMatchingParams,
        /// Columns of a tile: all columns of the frame if it is matched in one pass.
        tile_width: usize,
    },
    /// Semi-global matching, in one pass.
    SemiGlobal(SemiGlobalParams),
    /// Block matching from short baselines to long ones, in one pass: [`BlockMatchingParams::around`].
    ///
    /// Both matches run side by side: each disparity line of the short one is the prior line of the long one, which
    /// matches [gradients](multiscopic_core::Gradients). Unlike the host's `match`, no median filter comes between them,
    /// because it would take many more lines.
    AroundPrior {
        /// The match at short baselines, over the whole range.
        short: BlockMatchingParams,
        /// The search at long baselines around its disparities, in pixels of the long baseline. Its views stand where they
        /// were taken, before [`BlockMatchingParams::around`] divides their offsets.
        long: BlockMatchingParams,
    },
    /// Disparities and their confidences, in one pass.
    WithConfidences(WholeLines),
    /// The network, which gives confidences too. It needs whole frames in memory.
    Network(NetworkParams),
}

/// A method that confidences can be computed for: one that matches whole lines, and searches all of the range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum WholeLines {
    /// Block matching.
    Blocks(BlockMatchingParams),
    /// Semi-global matching. The confidences are fitted to sums of absolute differences as its cost.
    SemiGlobal(SemiGlobalParams),
}

impl WholeLines {
    /// The method without confidences.
    pub const fn alone(&self) -> Matching {
        match *self {
            WholeLines::Blocks(params) => Matching::Blocks { params, tile_width: params.width() },
            WholeLines::SemiGlobal(params) => Matching::SemiGlobal(params),
        }
    }

    /// The search.
    pub const fn search(&self) -> &SearchSpace {
        match self {
            WholeLines::Blocks(params) => params.search(),
            WholeLines::SemiGlobal(params) => params.search(),
        }
    }
}

impl Matching {
    /// From the baselines of a match to `multiple` times as long ones in the same directions: `num_disparities` are searched
    /// there around what it finds, with the same blocks and fusion. `None` if that is out of range: see [`SearchConfig`].
    pub const fn around_prior(short: BlockMatchingParams, multiple: u8, num_disparities: u16) -> Option<Matching> {
        let Some(views) = short.views().times(multiple) else { return None };
        let min_disparity = -((num_disparities / 2) as i16);
        let search = SearchConfig { views, min_disparity, num_disparities, ..short.search().config() };
        match search.block_matching(short.block_size() as u8) {
            Ok(long) => Some(Matching::AroundPrior { short, long }),
            Err(_) => None,
        }
    }

    /// The search; from short baselines to long ones, the search at the short ones.
    pub const fn search(&self) -> &SearchSpace {
        match self {
            Matching::Blocks { params, .. } | Matching::AroundPrior { short: params, .. } => params.search(),
            Matching::SemiGlobal(params) => params.search(),
            Matching::WithConfidences(lines) => lines.search(),
            Matching::Network(params) => params.search(),
        }
    }

    /// The search at long baselines around the disparities of [`search`](Matching::search).
    pub const fn long_search(&self) -> Option<&SearchSpace> {
        match self {
            Matching::Blocks { .. } | Matching::SemiGlobal(_) | Matching::WithConfidences(_) | Matching::Network(_) => None,
            Matching::AroundPrior { long, .. } => Some(long.search()),
        }
    }

    /// True if confidences are computed.
    pub const fn has_confidences(&self) -> bool {
        matches!(self, Matching::WithConfidences(_) | Matching::Network(_))
    }

    /// All searches. Each reads the centre and its own views.
    pub fn searches(&self) -> impl Iterator<Item = &SearchSpace> {
        [self.search()].into_iter().chain(self.long_search())
    }

    /// The views of all searches.
    pub fn views(&self) -> Views {
        self.searches().flat_map(|search| search.views().iter()).collect()
    }

    /// The number of disparity evaluations (pixel x disparity x view).
    pub fn evaluations(&self) -> u64 {
        self.searches().map(SearchSpace::evaluations).sum()
    }

    /// The block matching whose sums are the costs, at short baselines if there are long ones too; `None` for the census, which
    /// the network takes as well.
    pub fn block_matching(&self) -> Option<BlockMatchingParams> {
        match self {
            Matching::Blocks { params, .. } | Matching::AroundPrior { short: params, .. } => Some(*params),
            Matching::SemiGlobal(params) => match params.cost() {
                SemiGlobalCost::Sad { block_size } => BlockMatchingParams::block_matching(*params.search(), block_size).ok(),
                SemiGlobalCost::Census(_) => None,
            },
            Matching::WithConfidences(lines) => lines.alone().block_matching(),
            Matching::Network(_) => None,
        }
    }

    /// The method's name on command lines and in reports.
    pub const fn name(&self) -> &'static str {
        match self {
            Matching::Blocks { .. } | Matching::AroundPrior { .. } => "bm",
            Matching::SemiGlobal(_) => "sgm",
            Matching::WithConfidences(lines) => lines.alone().name(),
            Matching::Network(_) => "net",
        }
    }

    /// Columns of a tile.
    pub const fn tile_width(&self) -> usize {
        match self {
            Matching::Blocks { tile_width, .. } => *tile_width,
            Matching::SemiGlobal(_) | Matching::AroundPrior { .. } | Matching::WithConfidences(_) | Matching::Network(_) => {
                self.search().width()
            }
        }
    }

    /// The parts of the frame, each computed in a pass.
    pub fn tiles(&self) -> impl Iterator<Item = Region> + use<> {
        Region::tiles(self.search(), self.tile_width())
    }

    /// The latency in lines: the number of lines of the frame that is read furthest ahead, which are read before the first
    /// disparity line is out.
    pub fn latency_lines(&self) -> usize {
        match self {
            Matching::Blocks { params, .. } => params.latency_lines(),
            Matching::SemiGlobal(params) => params.latency_lines(),
            Matching::WithConfidences(lines) => {
                (lines.alone().latency_lines() + ConfidenceLines::LATENCY_LINES).min(self.search().height())
            }
            Matching::Network(params) => params.search().height(),
            // The first blocks of the long match need as many lines of the prior as their radius, and one more.
            Matching::AroundPrior { short, long } => {
                (short.latency_lines() + long.radius()).min(short.height()).max(long.around(short.search()).latency_lines())
            }
        }
    }

    /// The lengths of the workspace's buffers, the same on every processor.
    pub const fn lengths(&self) -> Lengths {
        self.lengths_with::<Native>()
    }

    /// [`lengths`](Matching::lengths) with a kernel of one's own choice.
    pub const fn lengths_with<I: Isa>(&self) -> Lengths {
        let matcher = match self {
            Matching::Blocks { params, tile_width } => Memory::new::<I>(params, *tile_width),
            Matching::SemiGlobal(params) => Memory::semi_global::<I>(params),
            Matching::AroundPrior { short, long } => {
                let around = Memory::new::<I>(&long.around(short.search()), long.width());
                Memory::new::<I>(short, short.width()).plus(&around)
            }
            Matching::WithConfidences(lines) => lines.alone().lengths_with::<I>().matcher,
            Matching::Network(params) => params.memory::<I>().of_matcher(),
        };
        let columns = self.tile_width();
        match self {
            Matching::WithConfidences(_) => {
                let packet = packet::buffer_bytes_with_confidences(columns);
                Lengths { matcher, confidence: confidence_bytes(columns), columns, packet }
            }
            Matching::Network(_) => {
                let confidence = size_of::<u32>() * confidence_line_words(columns);
                Lengths { matcher, confidence, columns, packet: packet::buffer_bytes_with_confidences(columns) }
            }
            _ => Lengths { matcher, confidence: 0, columns, packet: packet::buffer_bytes(columns) },
        }
    }
}

/// The parameters of a method that are a part of a [`Matching`], with the parameters `P`.
macro_rules! part_of_matching {
    ($(#[$attribute:meta])* $name:ident: $type:ty = $part:path) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $name<P> {
            /// Not read if `P` are constants.
            value: $type,
            of: PhantomData<P>,
        }

        impl<P> $name<P> {
            pub fn new(value: $type) -> $name<P> {
                $name { value, of: PhantomData }
            }
        }

        impl<P: Params<Matching>> Params<$type> for $name<P> {
            const KNOWN: Option<$type> = match P::KNOWN {
                Some(matching) => $part(&matching),
                None => None,
            };

            fn get(&self) -> &$type {
                match const { &Self::KNOWN } {
                    Some(known) => known,
                    None => &self.value,
                }
            }
        }
    };
}

part_of_matching!(
    /// Block matching, alone or at short baselines.
    BlockMatching: BlockMatchingParams = Matching::blocks
);
part_of_matching!(
    /// Block matching at long baselines around the disparities found at short ones.
    AroundPrior: BlockMatchingParams = Matching::around
);
part_of_matching!(
    /// Semi-global matching.
    SemiGlobal: SemiGlobalParams = Matching::semi_global
);

impl Matching {
    const fn blocks(&self) -> Option<BlockMatchingParams> {
        match *self {
            Matching::Blocks { params, .. }
            | Matching::AroundPrior { short: params, .. }
            | Matching::WithConfidences(WholeLines::Blocks(params)) => Some(params),
            _ => None,
        }
    }

    const fn around(&self) -> Option<BlockMatchingParams> {
        match *self {
            Matching::AroundPrior { short, long } => Some(long.around(short.search())),
            _ => None,
        }
    }

    const fn semi_global(&self) -> Option<SemiGlobalParams> {
        match *self {
            Matching::SemiGlobal(params) | Matching::WithConfidences(WholeLines::SemiGlobal(params)) => Some(params),
            _ => None,
        }
    }
}

/// The bytes of the lines that confidences are computed from, and of a line of them.
const fn confidence_bytes(columns: usize) -> usize {
    size_of::<u32>() * (ConfidenceLines::memory_words(columns) + confidence_line_words(columns))
}

/// The words of a line of confidences.
pub(crate) const fn confidence_line_words(columns: usize) -> usize {
    columns.div_ceil(size_of::<u32>())
}

/// The pointers' lengths of memory in front of a matcher's that its state is kept in, where the caller lends memory for both: in C.
/// It depends on the most views that the matcher takes, 4 or 8.
pub const fn state_pointers(views: usize) -> usize {
    if views > 4 { 420 } else { 260 }
}

/// The lengths of the buffers of a [`Workspace`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
    /// The lengths for the filter over the frames of a sweep, and what it sends.
    pub const fn of_sweep(params: &SweepParams) -> Lengths {
        let columns = params.search().width();
        let packet = packet::buffer_bytes_with_confidences(columns);
        Lengths { matcher: params.memory(), confidence: confidence_bytes(columns), columns, packet }
    }

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
/// use multiscopic_edge::{Workspace, profile::QQVGA, workspace};
///
/// // In firmware, a `static_cell::ConstStaticCell` that is taken once.
/// static WORKSPACE: Mutex<workspace!(QQVGA)> = Mutex::new(Workspace::new());
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

/// The type of the [`Workspace`] that a constant [`Profile`](crate::Profile), [`SweepProfile`](crate::SweepProfile) or [`Matching`]
/// needs.
#[macro_export]
macro_rules! workspace {
    ($matching:path) => {
        $crate::Workspace<
            { $matching.lengths().words() },
            { $matching.lengths().columns },
            { $matching.lengths().packet },
        >
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile;

    #[test]
    fn lengths_predict_the_size_of_the_static() {
        let sizes = [
            size_of::<workspace!(profile::QQVGA)>(),
            size_of::<workspace!(profile::QVGA)>(),
            size_of::<workspace!(profile::QVGA_TILED)>(),
            size_of::<workspace!(profile::VGA)>(),
            size_of::<workspace!(profile::VGA_TILED)>(),
            size_of::<workspace!(profile::QQVGA_SGM)>(),
            size_of::<workspace!(profile::QVGA_SGM)>(),
            size_of::<workspace!(profile::QQVGA_3X3)>(),
            size_of::<workspace!(profile::QVGA_PRIOR)>(),
            size_of::<workspace!(profile::QVGA_CONFIDENCE)>(),
            size_of::<workspace!(profile::QQVGA_SGM_CONFIDENCE)>(),
            size_of::<workspace!(profile::QQVGA_NET)>(),
        ];
        assert_eq!(sizes, profile::ALL.map(|profile| profile.lengths().bytes()));
        assert_eq!(size_of::<workspace!(profile::QQVGA_SWEEP)>(), profile::QQVGA_SWEEP.lengths().bytes());
    }

    #[test]
    fn lengths_are_rounded_up_to_words() {
        const ODD: Lengths = match profile::QQVGA.matching(multiscopic_core::Fusion::Min) {
            Matching::Blocks { params, .. } => Matching::Blocks { params, tile_width: 23 },
            other => other,
        }
        .lengths();
        type Odd = Workspace<{ ODD.words() }, { ODD.columns }, { ODD.packet }>;
        assert_eq!(size_of::<Odd>(), ODD.bytes());
    }
}
