//! Rectified lines against their reference.

use std::convert::Infallible;

use arbitrary::{Result, Unstructured};
use multiscopic_core::{Displacement, DisplacementGrid, Frame, Rectification, Rectified, ScanlineSource, View, Views};
use multiscopic_tests::reference::rectify;

use crate::support::assert_same;

/// The same image for every frame.
struct Source<'a> {
    image: &'a [u8],
    width: usize,
}

impl ScanlineSource for Source<'_> {
    type Error = Infallible;

    fn read_line(&mut self, _: Frame, v: usize, line: &mut [u8]) -> std::result::Result<(), Infallible> {
        line.copy_from_slice(&self.image[v * self.width..][..self.width]);
        Ok(())
    }
}

fn compare(input: &mut Unstructured) -> Result<()> {
    let [width, height]: [usize; 2] = [input.int_in_range(1..=40)?, input.int_in_range(1..=40)?];
    let spacing = 1_u8 << input.int_in_range(0..=7_u8)?;
    let grid = DisplacementGrid::new(width as u16, height as u16, spacing).expect("a valid grid");
    // Any displacement, or up to a pixel or two.
    let shift = *input.choose(&[0, 4, 8])?;
    let mut steps = || -> Result<i16> { Ok(input.arbitrary::<i16>()? >> shift) };
    let mut nodes =
        || (0..grid.nodes()).map(|_| Ok(Displacement { right: steps()?, down: steps()? })).collect::<Result<Vec<_>>>();
    let (common, own) = (nodes()?, nodes()?);
    let mut pixels = input.bytes(input.len())?.iter().copied().cycle();
    let image: Vec<u8> = (0..width * height).map(|_| pixels.next().unwrap_or_default()).collect();

    let right = Frame::View(View::RIGHT);
    let of_right = [(right, &own[..])];
    let rectification = Rectification::new(grid, &common, &of_right).expect("a displacement for each node");
    let views = Views::NONE.with(View::RIGHT);
    let mut memory = vec![0xA5A5_5A5A; rectification.memory(views).words()];
    let mut source = Source { image: &image, width };
    let mut rectified = Rectified::new(&mut source, &rectification, views, &mut memory).expect("enough memory");
    let reference = |nodes: &[Displacement]| {
        let nodes: Vec<_> = nodes.iter().map(|node| (node.right, node.down)).collect();
        rectify(&image, width, spacing.into(), &nodes)
    };
    let frames = [(Frame::Center, reference(&common)), (right, reference(&own))];
    let mut line = vec![0; width];
    for v in 0..height {
        for (frame, expected) in &frames {
            rectified.read_line(*frame, v, &mut line).expect("the source does not fail");
            assert_same(&line, &expected.pixels[v * width..][..width], &format!("line {v} of {frame}"));
        }
    }
    Ok(())
}

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let _ = compare(&mut Unstructured::new(bytes));
    true
}
