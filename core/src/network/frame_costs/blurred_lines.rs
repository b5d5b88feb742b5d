//! Lines of a frame that is blurred by a Gaussian.

/// A Gaussian with a standard deviation of 1.5 pixels, in 256ths: the weights of a pixel and of those 1 to 4 pixels to
/// either side.
const WEIGHTS: [u16; 5] = [68, 55, 28, 9, 2];
const _: () = assert!(WEIGHTS[0] + 2 * (WEIGHTS[1] + WEIGHTS[2] + WEIGHTS[3] + WEIGHTS[4]) == 256);

/// The reach of the Gaussian in pixels.
const REACH: usize = WEIGHTS.len() - 1;

/// The column sums that [`blur`] needs for a frame of `width` columns.
pub(super) const fn column_sums(width: usize) -> usize {
    width + 2 * REACH
}

/// Computes line `v` of the blurred frame, in 256ths of a grey level, rounded half up. `line` has a sample for each column, and
/// there are as many sums as [`column_sums`]. The frame is replicated beyond its borders.
// Along columns first, since a single line is blurred at a time. Sums are not rounded, so the order changes nothing.
#[inline(always)]
pub(super) fn blur(frame: &[u8], v: usize, sums: &mut [u16], blurred: &mut [u16]) {
    let width = blurred.len();
    let line = |v: usize| frame.get(v * width..(v + 1) * width);
    let Some((before, rest)) = sums.split_at_mut_checked(REACH) else { return };
    let Some((middle, after)) = rest.split_at_mut_checked(width) else { return };
    let last = frame.len().checked_div(width).unwrap_or_default().saturating_sub(1);
    // Sums are at most 256 times a sample, so that they fit 16 bits.
    for (sum, &sample) in middle.iter_mut().zip(line(v).unwrap_or_default()) {
        *sum = WEIGHTS[0] * u16::from(sample);
    }
    for (k, weight) in WEIGHTS.into_iter().enumerate().skip(1) {
        let (Some(above), Some(below)) = (line(v.saturating_sub(k)), line((v + k).min(last))) else { return };
        for ((sum, &above), &below) in middle.iter_mut().zip(above).zip(below) {
            *sum = sum.wrapping_add(weight * (u16::from(above) + u16::from(below)));
        }
    }
    let (Some(&first), Some(&end)) = (middle.first(), middle.last()) else { return };
    before.fill(first);
    after.fill(end);
    for (sample, sums) in blurred.iter_mut().zip(sums.windows(2 * REACH + 1)) {
        let &[a, b, c, d, e, f, g, h, i] = sums else { return };
        let [center, one, two, three, four] = WEIGHTS.map(u32::from);
        let pair = |one: u16, other: u16| u32::from(one) + u32::from(other);
        let total = center * u32::from(e) + one * pair(d, f) + two * pair(c, g) + three * pair(b, h) + four * pair(a, i);
        *sample = ((total + 128) >> 8) as u16;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the smallest sizes as well. A point of 32 has a total of exactly a half at the corners of the Gaussian.
    #[test]
    fn lines_have_the_blurred_samples_of_the_definition() {
        let noise: [u8; 120] = core::array::from_fn(|i| (i * i * 89 + i * 31 + i / 5) as u8);
        let point: [u8; 120] = core::array::from_fn(|i| if i == 5 * 12 + 6 { 32 } else { 0 });
        for (frame, width, height) in
            [(&noise, 1, 1), (&noise, 1, 7), (&noise, 3, 2), (&noise, 12, 10), (&noise, 16, 1), (&point, 12, 10)]
        {
            let frame = &frame[..width * height];
            let sample = |u: i32, v: i32| {
                let [u, v] = [(u, width), (v, height)].map(|(at, side)| at.clamp(0, side as i32 - 1) as usize);
                u32::from(frame[v * width + u])
            };
            let weight = |k: i32| u32::from(WEIGHTS[k.unsigned_abs() as usize]);
            for v in 0..height {
                let (mut sums, mut blurred) = ([99; 24], [99; 16]);
                blur(frame, v, &mut sums[..column_sums(width)], &mut blurred[..width]);
                for (u, &blurred) in blurred.iter().enumerate().take(width) {
                    let at = |du, dv| weight(du) * weight(dv) * sample(u as i32 + du, v as i32 + dv);
                    let total: u32 = (-4..=4).flat_map(|dv| (-4..=4).map(move |du| at(du, dv))).sum();
                    assert_eq!(u32::from(blurred), (total + 128) / 256, "({u}, {v}) of {width}x{height}");
                }
            }
        }
    }
}
