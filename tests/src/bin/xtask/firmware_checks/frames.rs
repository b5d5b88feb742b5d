//! The frames that the firmware reads, with the host's results for them, and those that it sends.

use anyhow::{Context, Result, bail, ensure};
use multiscopic::{
    DisparityMap, Engine, Frames, Method,
    files::Limits,
    scene::{PinholeCamera, Scene, render_views},
    stereo::{CostFunction, Pipeline, SemiGlobal, confidence_map::ConfidenceMap},
    target::reception::{self, Flaw, Notice, ReceivedFrame},
};
use multiscopic_core::{
    BlockMatchingParams, Disparity, Frame, Matcher, Region, SearchSpace, SemiGlobalCost, SemiGlobalMatcher, View, Views,
    network::NetworkParams,
};
use multiscopic_edge::{Matching, WholeLines, frame_file::FrameFile};
use multiscopic_tests::test_images::{
    ViewSet,
    core_match::StrictSource,
    read_grey,
    real_data::{self, Dataset},
    view_at,
};
use std::{fs, path::Path};

/// A named set of frames.
pub struct ImageSet {
    /// Its name in reports.
    pub name: &'static str,
    images: ViewSet,
}

impl ImageSet {
    /// The synthetic scene of `multiscopic demo`, which is the same on every machine.
    pub fn demo(matching: &Matching) -> ImageSet {
        let (width, height, wanted) = (matching.search().width(), matching.search().height(), matching.views());
        ImageSet::demo_middle([width, height], [width, height], wanted)
    }

    /// The central `[width, height]` pixels of the demo's scene rendered at `[w, h]` pixels, with these views.
    pub fn demo_middle([w, h]: [usize; 2], [width, height]: [usize; 2], views: Views) -> ImageSet {
        let camera = PinholeCamera { width: width as u32, height: height as u32, ..PinholeCamera::new(w as u32, h as u32) };
        let frames = render_views(&Scene::demo(), &camera, views, 1).frames(views);
        let gray = |frame| frames.get(frame).map(|image| image.as_raw().clone());
        let cross = View::CROSS.map(|view| gray(Frame::View(view)));
        let others = views.iter().filter(|view| !View::CROSS.contains(view));
        let others = others.filter_map(|view| Some((offset(view), gray(Frame::View(view))?))).collect();
        let center = gray(Frame::Center).unwrap_or_default();
        ImageSet { name: "demo", images: ViewSet { width, height, center, views: cross, others } }
    }

    /// The centre of the Tsukuba scene, if it is available, large enough, and has all views.
    pub fn tsukuba(matching: &Matching) -> Option<ImageSet> {
        let (width, height, wanted) = (matching.search().width(), matching.search().height(), matching.views());
        let root = real_data::root().filter(|root| root.join(Dataset::Tsukuba.name()).is_dir())?;
        let mut all = Dataset::Tsukuba.read(&root, "").images.only(View::CROSS.map(|view| wanted.contains(view)));
        for (right, down) in wanted.iter().filter(|view| !View::CROSS.contains(view)).map(offset) {
            let name = format!("scene1.row{}.col{}.ppm", 3 + down, 3 + right);
            let path = Some(root.join(Dataset::Tsukuba.name()).join(name)).filter(|path| path.is_file())?;
            all.others.push(((right, down), read_grey(&path).2));
        }
        let (left, top) = (all.width.checked_sub(width)? / 2, all.height.checked_sub(height)? / 2);
        Some(ImageSet { name: Dataset::Tsukuba.name(), images: all.crop(left, top, width, height) })
    }

    /// Writes the frames as files that the firmware reads.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let views = View::CROSS.map(Frame::View).into_iter().zip(&self.images.views);
        let views = views.filter_map(|(frame, pixels)| Some((frame, pixels.as_ref()?)));
        let others = self.images.others.iter().map(|(offset, pixels)| (Frame::View(view_at(*offset)), pixels));
        for (frame, pixels) in [(Frame::Center, &self.images.center)].into_iter().chain(views).chain(others) {
            let path = folder.join(FrameFile::new(frame).name().to_str()?);
            fs::write(&path, pixels).with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    /// The frames in the host's type.
    pub fn frames(&self) -> Frames {
        self.images.frames()
    }

    /// The disparities that the core computes on this machine, line by line. From short baselines to long ones, it
    /// stores those of the whole short match before the long match begins.
    pub fn disparities(&self, matching: &Matching) -> Result<Vec<Option<Disparity>>> {
        match matching {
            Matching::Blocks { params, .. } => self.matched_blocks(params),
            Matching::WithConfidences(lines) => self.disparities(&lines.alone()),
            Matching::Network(params) => Ok(self.by_network(params)?.0.pixels().to_vec()),
            Matching::AroundPrior { short, long } => {
                let prior = DisparityMap::new(short.width(), short.height(), self.matched_blocks(short)?);
                let long = long.around(short.search());
                let refined = Engine::new(None, 1)?.disparities_around(&self.frames().planes(), &prior, &long, &|| ())?;
                Ok(refined.pixels().to_vec())
            }
            Matching::SemiGlobal(params) => {
                let (mut line, mut disparities) = (vec![None; params.search().width()], Vec::new());
                let mut source = StrictSource::semi_global(&self.images, params);
                let mut memory = vec![0; params.memory_words()];
                let mut matcher = SemiGlobalMatcher::new(params, &mut memory)?;
                while matcher.next_line(&mut source, &mut line)?.is_some() {
                    source.line_done();
                    disparities.extend_from_slice(&line);
                }
                Ok(disparities)
            }
        }
    }

    /// The confidences that the host's methods compute, if `matching` has any.
    pub fn confidences(&self, matching: &Matching) -> Result<Option<ConfidenceMap>> {
        let lines = match matching {
            Matching::WithConfidences(lines) => lines,
            Matching::Network(params) => return Ok(Some(self.by_network(params)?.1)),
            _ => return Ok(None),
        };
        let method = match lines {
            WholeLines::Blocks(params) => Method::block_matching(params.block_size() as u8),
            WholeLines::SemiGlobal(params) => {
                let SemiGlobalCost::Sad { block_size } = params.cost() else { bail!("profiles match sums of differences") };
                let paths = SemiGlobal::default_for(params.cost(), params.search().views().len());
                Method::new(Pipeline::SemiGlobal { cost: CostFunction::Sad { block_size }, paths })
            }
        };
        Ok(Some(method.disparities_and_confidences(&Engine::new(None, 2)?, &self.frames(), lines.search(), &())?.1))
    }

    /// Computes disparities and confidences with the host's network.
    fn by_network(&self, params: &NetworkParams) -> Result<(DisparityMap, ConfidenceMap)> {
        let method = Method { long_baselines: None, ..Method::net() };
        Ok(method.disparities_and_confidences(&Engine::new(None, 2)?, &self.frames(), params.search(), &())?)
    }

    fn matched_blocks(&self, params: &BlockMatchingParams) -> Result<Vec<Option<Disparity>>> {
        let (mut line, mut disparities) = (vec![None; params.width()], Vec::new());
        let mut source = StrictSource::new(&self.images, params, &Region::whole(params.search()));
        let mut memory = vec![0; params.memory_words()];
        let mut matcher = Matcher::new(params, &mut memory)?;
        while matcher.next_line(&mut source, &mut line)?.is_some() {
            source.line_done();
            disparities.extend_from_slice(&line);
        }
        Ok(disparities)
    }
}

/// The baselines of a view to the right and down.
fn offset(view: View) -> (i32, i32) {
    (view.right().into(), view.down().into())
}

/// The frame in `bytes`, which were read from `path`. Fails unless every pixel comes exactly once, undamaged,
/// and nothing else follows.
pub fn whole(mut bytes: &[u8], path: &Path, search: &SearchSpace) -> Result<ReceivedFrame> {
    let mut flaws: Vec<Flaw> = Vec::new();
    let received = reception::receive(&mut bytes, path, Limits::DEFAULT, |notice| match notice {
        Notice::Flaw(flaw) => flaws.push(flaw),
        Notice::Line { .. } | Notice::Late => {}
    })?;
    ensure!(flaws.is_empty(), "{}", flaws.iter().map(Flaw::to_string).collect::<Vec<_>>().join("; "));
    let size = |map: &DisparityMap| (map.width(), map.height());
    let (found, expected) = (size(&received.disparities), (search.width(), search.height()));
    ensure!(found == expected, "a frame of {found:?} pixels, expected {expected:?}");
    ensure!(received.is_complete(), "{} pixels of {found:?} were received", received.pixels);
    ensure!(bytes.is_empty(), "{} bytes follow the end of the frame", bytes.len());
    Ok(received)
}

/// Fails at the first pixel that differs from `expected`, given line by line.
pub fn same(found: &DisparityMap, expected: &[Option<Disparity>]) -> Result<()> {
    let show = |pixel: &Option<Disparity>| pixel.map_or("invalid".to_owned(), |disparity| disparity.to_string());
    for (i, (pixel, expected)) in found.pixels().iter().zip(expected).enumerate() {
        let (u, v) = (i % found.width(), i / found.width());
        ensure!(pixel == expected, "pixel ({u}, {v}): the firmware found {}, this machine {}", show(pixel), show(expected));
    }
    Ok(())
}

/// Fails at the first confidence that differs from `expected`, or if one map has confidences alone.
pub fn same_confidences(found: Option<&ConfidenceMap>, expected: Option<&ConfidenceMap>) -> Result<()> {
    let (found, expected) = match (found, expected) {
        (Some(found), Some(expected)) => (found, expected),
        (None, None) => return Ok(()),
        _ => bail!("the firmware sent confidences: {}; this machine computed some: {}", found.is_some(), expected.is_some()),
    };
    for (i, (found_here, expected)) in found.pixels().iter().zip(expected.pixels()).enumerate() {
        let (u, v) = (i % found.width(), i / found.width());
        ensure!(found_here == expected, "pixel ({u}, {v}): the firmware's confidence is {found_here}, this machine's {expected}");
    }
    Ok(())
}

/// Fails unless the packets of lines are equal. The last packet reports the depth of the stack, and may
/// differ.
pub fn same_lines(found: &[u8], simulated: &[u8]) -> Result<()> {
    let packets = |bytes: &[u8]| bytes.split_inclusive(|&byte| byte == 0).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let (found, simulated) = (packets(found), packets(simulated));
    ensure!(found.len() == simulated.len(), "{} packets were received, {} were simulated", found.len(), simulated.len());
    let lines = found.len().saturating_sub(1);
    let differs = (0..lines).find(|&i| found[i] != simulated[i]);
    ensure!(differs.is_none(), "packet {} differs from the simulated one", differs.unwrap_or_default());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    use multiscopic_core::{BlockMatchingParams, Fusion, Region, SearchConfig, valid};
    use multiscopic_edge::packet::{Sender, buffer_bytes};

    const SEARCH: SearchConfig = SearchConfig { fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(3, 2) };
    const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(3));

    /// The packets of a frame of twos, without the packet `without`, followed by `noise`.
    fn sent(without: Option<usize>, noise: &[u8]) -> Vec<u8> {
        let mut buffer = vec![0; buffer_bytes(3)];
        let mut sender = Sender::new(PARAMS.search(), &mut buffer);
        let line = [Disparity::from_bits(128); 3];
        let mut packets: Vec<_> =
            (0..2).map(|v| sender.line(&Region::whole(PARAMS.search()), v, &line).unwrap().to_vec()).collect();
        packets.push(sender.end(Some(77)).unwrap().to_vec());
        packets.push(noise.to_vec());
        let packets = packets.into_iter().enumerate().filter(|&(i, _)| Some(i) != without);
        packets.flat_map(|(_, packet)| packet).collect()
    }

    fn error(bytes: &[u8], params: &BlockMatchingParams) -> String {
        whole(bytes, Path::new("packets"), params.search()).unwrap_err().to_string()
    }

    #[test]
    fn a_whole_frame_is_received() {
        let received = whole(&sent(None, b""), Path::new("packets"), PARAMS.search()).unwrap();
        assert_eq!(received.stack, Some(77));
        let mut expected = [Disparity::from_bits(128); 6];
        assert!(same(&received.disparities, &expected).is_ok());
        expected[4] = None;
        let difference = same(&received.disparities, &expected).unwrap_err().to_string();
        assert_eq!(difference, "pixel (1, 1): the firmware found 2, this machine invalid");
    }

    #[test]
    fn confidences_are_compared() {
        let map = |last| ConfidenceMap::new(3, 2, vec![9, 9, 9, 9, 9, last]);
        assert!(same_confidences(None, None).is_ok() && same_confidences(Some(&map(1)), Some(&map(1))).is_ok());
        let error = |found: Option<&_>, expected: Option<&_>| same_confidences(found, expected).unwrap_err().to_string();
        let difference = error(Some(&map(1)), Some(&map(2)));
        assert_eq!(difference, "pixel (2, 1): the firmware's confidence is 1, this machine's 2");
        assert_eq!(error(None, Some(&map(1))), "the firmware sent confidences: false; this machine computed some: true");
    }

    #[test]
    fn packets_of_lines_are_compared() {
        let found = sent(None, b"");
        let mut other = found.clone();
        assert!(same_lines(&found, &found).is_ok());
        *other.iter_mut().rev().nth(3).unwrap() ^= 1;
        assert!(same_lines(&found, &other).is_ok(), "the end may differ");
        other[4] ^= 1;
        assert_eq!(same_lines(&found, &other).unwrap_err().to_string(), "packet 0 differs from the simulated one");
        assert_eq!(same_lines(&found, &sent(Some(1), b"")).unwrap_err().to_string(), "3 packets were received, 2 were simulated");
    }

    #[test]
    fn incomplete_frames_and_excess_bytes_are_refused() {
        assert_eq!(error(&sent(Some(1), b""), &PARAMS), "line 1 (packet 1) is lost");
        assert!(error(&sent(Some(2), b""), &PARAMS).starts_with("the end of the frame is lost"));
        assert_eq!(error(&sent(None, b"more"), &PARAMS), "4 bytes follow the end of the frame");
        let other =
            SearchConfig { fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(2, 3) }.block_matching(3).unwrap();
        assert_eq!(error(&sent(None, b""), &other), "a frame of (3, 2) pixels, expected (2, 3)");
    }
}
