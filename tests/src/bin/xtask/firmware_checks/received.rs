//! Frames received from the firmware.

use anyhow::{Result, bail, ensure};
use multiscopic::{
    DisparityMap,
    files::Limits,
    stereo::confidence_map::ConfidenceMap,
    target::reception::{self, Flaw, Notice, ReceivedFrame},
};
use multiscopic_core::{Disparity, SearchSpace};
use std::path::Path;

/// The frame in `bytes`, which were read from `path`. Fails unless every pixel comes exactly once, undamaged,
/// and nothing else follows.
pub fn whole(mut bytes: &[u8], path: &Path, search: &SearchSpace) -> Result<ReceivedFrame> {
    let mut flaws: Vec<Flaw> = Vec::new();
    let received = reception::receive(&mut bytes, path, Limits::DEFAULT, |notice| match notice {
        Notice::Flaw(flaw) => flaws.push(flaw),
        Notice::Line { .. } => {}
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
    use multiscopic_core::SearchConfig;
    use multiscopic_core::{BlockMatchingParams, Fusion, Region};
    use multiscopic_edge::packet::{Sender, buffer_bytes};

    const SEARCH: SearchConfig = SearchConfig { fusion: Fusion::Min, num_disparities: 4, ..SearchConfig::of_size(3, 2) };
    const PARAMS: BlockMatchingParams = match SEARCH.block_matching(3) {
        Ok(params) => params,
        Err(_) => panic!("the parameters are out of range"),
    };

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
