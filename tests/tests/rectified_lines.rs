//! Rectified lines equal the dense reference, bit for bit, and are made of as few stored lines as can be.

use std::{cell::Cell, fmt::Debug};

use multiscopic_core::{
    BlockMatchingParams, Disparity, Displacement, DisplacementGrid, Frame, Fusion, Matcher, Memory, MemoryTooSmall,
    Rectification, Rectified, RectifiedError, Region, Rewind, ScanlineSource, SearchConfig, View, Views, kernel::Portable,
};
use multiscopic_reference::{RectifiedImage, rectify, split_mix::Random};

/// Frames and displacements.
struct Case {
    width: usize,
    height: usize,
    grid: DisplacementGrid,
    /// The frames with their images.
    images: Vec<(Frame, Vec<u8>)>,
    common: Vec<Displacement>,
    own: Vec<(Frame, Vec<Displacement>)>,
}

impl Case {
    fn random(random: &mut Random) -> Case {
        let (width, height) = match random.below(4) {
            0 => (1 + random.below(3), 1 + random.below(40)),
            1 => (1 + random.below(40), 1 + random.below(3)),
            _ => (1 + random.below(40), 1 + random.below(40)),
        };
        Case::of_size(width, height, 1 << random.below(8), random)
    }

    fn of_size(width: usize, height: usize, spacing: u8, random: &mut Random) -> Case {
        let grid = DisplacementGrid::new(width as u16, height as u16, spacing).expect("a valid grid");
        let views = View::CROSS.into_iter().filter(|_| random.below(2) == 0).map(Frame::View);
        let frames: Vec<Frame> = [Frame::Center].into_iter().chain(views).collect();
        let levels = [1, 255][random.below(2)];
        let image = |random: &mut Random| (0..width * height).map(|_| random.byte() | !levels).collect();
        let images = frames.iter().map(|&frame| (frame, image(random))).collect();
        let common = displacements(&grid, random);
        let own = frames.into_iter().filter(|_| random.below(3) == 0).collect::<Vec<_>>();
        let own = own.into_iter().map(|frame| (frame, displacements(&grid, random))).collect();
        Case { width, height, grid, images, common, own }
    }

    fn views(&self) -> Views {
        self.images
            .iter()
            .filter_map(|(frame, _)| match frame {
                Frame::View(view) => Some(*view),
                Frame::Center => None,
            })
            .collect()
    }

    fn own(&self) -> Vec<(Frame, &[Displacement])> {
        self.own.iter().map(|(frame, nodes)| (*frame, &nodes[..])).collect()
    }

    fn image(&self, frame: Frame) -> &[u8] {
        &self.images.iter().find(|(other, _)| *other == frame).expect("one of the frames").1
    }

    /// The references of all frames.
    fn references(&self) -> Vec<(Frame, RectifiedImage)> {
        self.images.iter().map(|&(frame, _)| (frame, self.reference(frame))).collect()
    }

    /// The reference of a frame.
    fn reference(&self, frame: Frame) -> RectifiedImage {
        let nodes = self.own.iter().find(|(other, _)| *other == frame).map_or(&self.common, |(_, nodes)| nodes);
        let nodes: Vec<_> = nodes.iter().map(|node| (node.right, node.down)).collect();
        rectify(self.image(frame), self.width, self.grid.spacing(), &nodes)
    }
}

/// Displacements of a kind: none, of a tilted camera, or at random, up to any size.
fn displacements(grid: &DisplacementGrid, random: &mut Random) -> Vec<Displacement> {
    let (most, slope) = ([0, 20, 200, 2000, 32767][random.below(5)], random.below(3) == 0);
    let mut between = |most: i32| random.below(2 * most as usize + 1) as i32 - most;
    let mut plane = || [between(most), between(20), between(20)];
    let planes = [plane(), plane()];
    (0..grid.nodes())
        .map(|k| {
            let (i, j) = ((k % grid.columns()) as i32, (k / grid.columns()) as i32);
            let mut steps = |[constant, right, down]: [i32; 3]| {
                let steps = if slope { constant + right * i + down * j } else { between(most) };
                steps.clamp(i16::MIN.into(), i16::MAX.into()) as i16
            };
            Displacement { right: steps(planes[0]), down: steps(planes[1]) }
        })
        .collect()
}

/// A source that panics unless each line of each frame is requested once, in ascending order and not too early, and that fails
/// at random.
struct Strict<'a> {
    case: &'a Case,
    /// The last line that may be read now.
    limit: &'a Cell<usize>,
    /// The next line of each frame, or `None` if it may be any.
    next: Vec<Option<usize>>,
    /// The number of calls in ten that fail, and the last line that failed.
    rate: usize,
    failed: Option<(Frame, usize)>,
    random: Random,
}

impl<'a> Strict<'a> {
    fn new(case: &'a Case, limit: &'a Cell<usize>, rate: usize) -> Strict<'a> {
        Strict { case, limit, next: vec![Some(0); case.images.len()], rate, failed: None, random: Random(7) }
    }

    /// Panics unless all lines were read.
    fn assert_finished(&self) {
        assert!(self.next.iter().all(|next| *next == Some(self.case.height)), "lines are left over: {:?}", self.next);
    }
}

impl ScanlineSource for Strict<'_> {
    type Error = (Frame, usize);

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), (Frame, usize)> {
        let place = self.case.images.iter().position(|(other, _)| *other == frame).expect("one of the frames");
        assert!(v < self.case.height, "line {v} is outside the frame");
        assert_eq!(v, self.next[place].unwrap_or(v), "the line of {frame} that comes next");
        assert!(v <= self.limit.get(), "line {v} of {frame} is read although {} is the last that is needed", self.limit.get());
        assert_eq!(line.len(), self.case.width);
        if let Some(failed) = self.failed.take() {
            assert_eq!((frame, v), failed, "the line that failed is asked for again");
        }
        if self.random.below(10) < self.rate {
            line.fill_with(|| self.random.byte());
            self.failed = Some((frame, v));
            return Err((frame, v));
        }
        self.next[place] = Some(v + 1);
        line.copy_from_slice(&self.case.image(frame)[v * self.case.width..][..self.case.width]);
        Ok(())
    }

    fn read_prior(&mut self, v: usize, line: &mut [Option<Disparity>]) -> Result<(), (Frame, usize)> {
        line.fill(Disparity::from_bits(v as i16));
        Ok(())
    }
}

impl Rewind for Strict<'_> {
    fn rewind(&mut self) -> Result<(), (Frame, usize)> {
        self.next.fill(None);
        Ok(())
    }
}

/// Memory with any content, as much as the formula says.
fn memory(rectification: &Rectification<'_>, views: Views) -> Vec<u32> {
    vec![0xA5A5_5A5A; rectification.memory(views).words()]
}

/// The last line of the source that each rectified line makes it necessary to read: all, for the last one.
fn furthest(reference: &RectifiedImage) -> Vec<usize> {
    let mut furthest: Vec<_> = reference
        .lines
        .iter()
        .scan(0, |furthest, lines| {
            *furthest = lines.iter().copied().chain([*furthest]).max()?;
            Some(*furthest)
        })
        .collect();
    *furthest.last_mut().expect("a line") = usize::MAX;
    furthest
}

/// Lines of all frames in turn are those of the reference, although the source fails now and then. No line of the source is
/// read earlier than it is needed, and each is read in the end.
#[test]
fn rectified_lines_are_those_of_the_reference() {
    let mut random = Random(1);
    for number in 0..3000 {
        let case = Case::random(&mut random);
        let (own, limit) = (case.own(), Cell::new(0));
        let rectification = Rectification::new(case.grid, &case.common, &own).expect("a displacement for each node");
        let mut memory = memory(&rectification, case.views());
        let mut source = Strict::new(&case, &limit, [0, 3][random.below(2)]);
        let mut rectified = Rectified::new(&mut source, &rectification, case.views(), &mut memory).expect("enough memory");
        let references = case.references();
        let mut line = vec![0; case.width];
        for v in 0..case.height {
            for (frame, reference) in &references {
                limit.set(furthest(reference)[v]);
                while let Err(error) = rectified.read_line(*frame, v, &mut line) {
                    assert!(matches!(error, RectifiedError::Source(_)), "{error:?}");
                }
                assert_eq!(line, reference.pixels[v * case.width..][..case.width], "case {number}: line {v} of {frame}");
            }
        }
        source.assert_finished();
    }
}

/// A line of the source must be kept from when it is read, in order and no earlier than needed, until the last line that it
/// is part of. The formula is the most lines that are kept at once, found line by line.
#[test]
fn no_line_less_could_be_stored() {
    let mut random = Random(2);
    let mut memory_of_cases = 0;
    for number in 0..3000 {
        let case = Case::random(&mut random);
        let own = case.own();
        let rectification = Rectification::new(case.grid, &case.common, &own).expect("a displacement for each node");
        let mut stored = 0;
        for (frame, reference) in case.references() {
            let lines = (0..case.height).map(|v| {
                let read = reference.lines[..=v].iter().flatten().max().expect("a line");
                let kept = reference.lines[v..].iter().flatten().min().expect("a line");
                read + 1 - kept
            });
            let most = lines.max().expect("a line");
            assert_eq!(rectification.stored_lines(frame), most, "case {number}: {frame}");
            stored += most * case.width;
        }
        let words = rectification.memory(case.views()).words();
        assert_eq!(words, stored.div_ceil(4), "case {number}");
        memory_of_cases += words;

        let limit = Cell::new(0);
        let mut lent = vec![0; words - 1];
        let refused = Rectified::new(Strict::new(&case, &limit, 0), &rectification, case.views(), &mut lent).map(drop);
        assert_eq!(refused.expect_err("one word less"), MemoryTooSmall { needed: words, given: words - 1 });
    }
    assert!(memory_of_cases > 100_000, "cases store next to nothing: {memory_of_cases} words");
}

/// After a rewind, any line is the first, and the source starts no later than at the first line that it needs.
#[test]
fn passes_begin_anywhere_after_a_rewind() {
    let mut random = Random(3);
    let limit = Cell::new(usize::MAX);
    for number in 0..1000 {
        let case = Case::random(&mut random);
        let own = case.own();
        let rectification = Rectification::new(case.grid, &case.common, &own).expect("a displacement for each node");
        let mut memory = memory(&rectification, case.views());
        let mut source = Strict::new(&case, &limit, 0);
        source.rewind().expect("a source that does not fail");
        let mut rectified = Rectified::new(source, &rectification, case.views(), &mut memory).expect("enough memory");
        let mut line = vec![0; case.width];
        for _ in 0..3 {
            let first = random.below(case.height);
            let end = first + 1 + random.below(case.height - first);
            for (frame, reference) in &case.references() {
                for v in first..end {
                    rectified.read_line(*frame, v, &mut line).expect("the next line");
                    assert_eq!(line, reference.pixels[v * case.width..][..case.width], "case {number}: line {v} of {frame}");
                }
            }
            rectified.rewind().expect("a source that does not fail");
        }
    }
}

#[test]
fn what_is_not_the_next_line_is_refused_and_nothing_is_read() {
    let mut random = Random(4);
    let case = Case { own: Vec::new(), ..Case::of_size(9, 12, 8, &mut random) };
    let limit = Cell::new(usize::MAX);
    let rectification = Rectification::new(case.grid, &case.common, &[]).expect("a displacement for each node");
    let mut memory = memory(&rectification, Views::NONE);
    let mut source = Strict::new(&case, &limit, 0);
    source.rewind().expect("a source that does not fail");
    let mut rectified = Rectified::new(source, &rectification, Views::NONE, &mut memory).expect("enough memory");
    rectified.read_line(Frame::Center, 3, &mut [0; 9]).expect("any line is the first");
    let not_next = [(Frame::Center, 3), (Frame::Center, 2), (Frame::Center, 5), (Frame::View(View::LEFT), 4)];
    for (frame, v) in not_next {
        assert_eq!(rectified.read_line(frame, v, &mut [0; 9]), Err(RectifiedError::NotNext { frame, v }));
    }
    for given in [0, 8, 10] {
        let error = rectified.read_line(Frame::Center, 4, &mut vec![0; given]);
        assert_eq!(error, Err(RectifiedError::LineLength { needed: 9, given }));
    }
    for v in 4..12 {
        rectified.read_line(Frame::Center, v, &mut [0; 9]).expect("the next line");
    }
    let v = 12;
    assert_eq!(rectified.read_line(Frame::Center, v, &mut [0; 9]), Err(RectifiedError::NotNext { frame: Frame::Center, v }));
    let mut prior = [None; 9];
    rectified.read_prior(5, &mut prior).expect("a source that does not fail");
    assert_eq!(prior, [Disparity::from_bits(5); 9], "the prior is handed on");
}

#[test]
fn grids_are_checked() {
    for (width, height, spacing) in [(0, 5, 8), (5, 0, 8), (5, 5, 0), (5, 5, 3), (5, 5, 129)] {
        assert_eq!(DisplacementGrid::new(width, height, spacing), None, "{width} x {height}, {spacing}");
    }
    let grid = DisplacementGrid::new(17, 16, 8).expect("a valid grid");
    assert_eq!((grid.columns(), grid.rows(), grid.nodes()), (4, 3, 12));
    let (right, wrong) = ([Displacement::ZERO; 12], [Displacement::ZERO; 11]);
    assert!(Rectification::new(grid, &wrong, &[]).is_err());
    let error = Rectification::new(grid, &right, &[(Frame::View(View::TOP), &wrong)]).expect_err("one node is missing");
    assert_eq!(error.to_string(), "the grid has 12 nodes, 11 displacements were given for frame top");
}

/// Matching pulls rectified lines, in tiles and bands as well, and finds what it finds in images rectified beforehand.
#[test]
fn matching_rectified_lines_is_matching_rectified_images() {
    let mut random = Random(5);
    let limit = Cell::new(usize::MAX);
    for number in 0..300 {
        let (width, height) = (1 + random.below(30), 1 + random.below(30));
        let case = Case::of_size(width, height, 1 << random.below(6), &mut random);
        let (own, views) = (case.own(), case.views());
        if views.is_empty() {
            continue;
        }
        let rectification = Rectification::new(case.grid, &case.common, &own).expect("a displacement for each node");
        let images = case.references().into_iter().map(|(frame, reference)| (frame, reference.pixels)).collect();
        let straight = vec![Displacement::ZERO; case.grid.nodes()];
        let beforehand = Case { width, height, grid: case.grid, images, common: straight, own: Vec::new() };
        let params = SearchConfig {
            width: width as u16,
            height: height as u16,
            views,
            fusion: Fusion::Heuristic,
            min_disparity: -2,
            num_disparities: 8,
        }
        .block_matching(5)
        .expect("valid parameters");
        let (tile_width, band_height) = (1 + random.below(width), 1 + random.below(height));
        let regions = Region::tiles(params.search(), tile_width).chain(Region::bands(params.search(), band_height));

        let mut memory = memory(&rectification, views);
        let source = Strict::new(&case, &limit, 0);
        let mut rectified = Rectified::new(source, &rectification, views, &mut memory).expect("enough memory");
        for region in regions {
            rectified.rewind().expect("a source that does not fail");
            let found = disparities(&params, &region, &mut rectified);
            let mut source = Strict::new(&beforehand, &limit, 0);
            source.rewind().expect("a source that does not fail");
            assert_eq!(found, disparities(&params, &region, &mut source), "case {number}: {region:?}");
        }
    }
}

/// The disparities of a region.
fn disparities(
    params: &BlockMatchingParams,
    region: &Region,
    source: &mut impl ScanlineSource<Error: Debug>,
) -> Vec<Option<Disparity>> {
    let mut memory = vec![0; Memory::new::<Portable<4>>(params, region.width()).words()];
    let mut matcher = Matcher::with_isa(Portable::<4, 1>, params, region, &mut memory).expect("enough memory");
    let (mut line, mut found) = (vec![None; region.width()], Vec::new());
    while matcher.next_line(source, &mut line).expect("a source that does not fail").is_some() {
        found.extend(&line);
    }
    found
}
