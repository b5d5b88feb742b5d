//! Small matches, made of bytes.

use arbitrary::{Arbitrary, Result, Unstructured};
use multiscopic_core::{View, Views};
use multiscopic_tests::{
    reference::Fusion,
    test_images::{
        case::{Appearance, Case},
        view_set::ViewSet,
    },
};

/// The longest side of an image.
const MAX_SIDE: usize = 20;
/// The most samples of a block that the reference adds up, in all.
const MAX_SAMPLES: u64 = 50_000;
/// The most candidates in all views, with those outside of the frame, and the most pixels that they span: the core has sums for
/// the former and replicates the borders to the latter.
const MAX_STEPS: usize = 200_000;

/// A match that its reference does in milliseconds.
#[derive(Debug)]
pub struct SmallMatch {
    /// Its parameters. The images are not made of its texture and seed.
    pub case: Case,
    /// Its images.
    pub images: ViewSet,
}

impl<'a> Arbitrary<'a> for SmallMatch {
    fn arbitrary(input: &mut Unstructured<'a>) -> Result<SmallMatch> {
        let seed = input.arbitrary()?;
        let [width, height] = [input.int_in_range(1..=MAX_SIDE)?, input.int_in_range(1..=MAX_SIDE)?];
        let views: [bool; 4] = input.arbitrary()?;
        let mut others = Vec::new();
        let count = input.int_in_range(0..=3)?;
        while others.len() < count {
            let offset = (input.int_in_range(-16..=16)?, input.int_in_range(-16..=16)?);
            let is_near = offset.0 * offset.0 + offset.1 * offset.1 <= 1;
            if is_near || others.contains(&offset) {
                break;
            }
            others.push(offset);
        }
        let views = if others.is_empty() && views == [false; 4] { [false, true, false, false] } else { views };
        let min_disparity = input.int_in_range(-511..=511)?;
        let num_disparities = input.int_in_range(1..=512 - min_disparity)?;
        let fusion = *input.choose(&[Fusion::Min, Fusion::Mean, Fusion::Heuristic, Fusion::Half])?;
        let radius = input.int_in_range(0..=10)?;
        let texture = Appearance::Noise;
        let block_size = 2 * radius + 1;
        let case = Case { width, height, views, others, fusion, min_disparity, num_disparities, block_size, texture, seed };
        let params = case.params();
        let views = params.search().views();
        let steps = |view: View| {
            let (right, down) = view.shift(num_disparities as i16);
            let [right, down] = [right, down].map(|pixels| pixels.unsigned_abs() as usize);
            width * height * num_disparities as usize + (width + right) * (height + down)
        };
        if params.evaluations() * (block_size * block_size) as u64 > MAX_SAMPLES
            || views.iter().map(steps).sum::<usize>() > MAX_STEPS
            || views.len() > Views::MAX_MATCHED
        {
            return Err(arbitrary::Error::IncorrectFormat);
        }
        let images = images(&case, input)?;
        Ok(SmallMatch { case, images })
    }
}

/// The images of a match. Their pixels are bytes of the input, over and over.
fn images(case: &Case, input: &mut Unstructured) -> Result<ViewSet> {
    let len = case.width * case.height;
    let mut pixels = input.bytes(input.len())?.iter().copied().cycle();
    let mut image = || -> Vec<u8> {
        let mut image: Vec<u8> = pixels.by_ref().take(len).collect();
        image.resize(len, 0);
        image
    };
    Ok(ViewSet {
        width: case.width,
        height: case.height,
        center: image(),
        views: case.views.map(|is_there| is_there.then(&mut image)),
        others: case.others.iter().map(|&offset| (offset, image())).collect(),
    })
}
