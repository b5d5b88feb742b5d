//! COBS, which removes the zeros from a packet so that a zero can end it.

/// The most bytes between two codes.
const MAX_RUN: usize = 254;

/// The most bytes that [`encode`] makes of `bytes`: a code for every 254, one more code, and the final zero.
pub(super) const fn max_encoded_bytes(bytes: usize) -> usize {
    bytes + bytes.div_ceil(MAX_RUN) + 2
}

/// Encodes `bytes` and the final zero into `encoded`. Returns the length, or nothing if `encoded` is too
/// short.
///
/// The crate `cobs`, which decodes the packets, encodes byte by byte. Zeros are rare in disparities, so this
/// copies the runs between them, which saves a seventh of the instructions that sending a line takes on a
/// Cortex-M4.
pub(super) fn encode(bytes: &[u8], mut encoded: &mut [u8]) -> Option<usize> {
    let (mut rest, mut len) = (bytes, 0);
    loop {
        let window = rest.get(..MAX_RUN).unwrap_or(rest);
        let run = window.iter().position(|&byte| byte == 0).unwrap_or(window.len());
        let (code, after) = encoded.split_first_mut()?;
        let (copy, after) = after.split_at_mut_checked(run)?;
        *code = run as u8 + 1;
        copy.copy_from_slice(rest.get(..run)?);
        (encoded, len) = (after, len + 1 + run);
        // Every code stands for the zero after its run, except after a run of full length.
        rest = match rest.get(run + usize::from(run < MAX_RUN)..) {
            Some(rest) if run < MAX_RUN || !rest.is_empty() => rest,
            _ => break,
        };
    }
    *encoded.first_mut()? = 0;
    Some(len + 1)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::{vec, vec::Vec};

    #[test]
    fn runs_of_all_lengths_are_decoded_by_the_crate_cobs() {
        for len in (0usize..20).chain(245..270).chain(500..520).chain(755..775) {
            for zeros in
                [vec![], vec![0], vec![253], vec![254], vec![255], vec![len / 2, len / 2 + 1], vec![len.saturating_sub(1)]]
            {
                let bytes: Vec<u8> = (0..len).map(|i| if zeros.contains(&i) { 0 } else { i as u8 | 1 }).collect();
                let mut encoded = vec![0xaa; max_encoded_bytes(len)];
                let end = encode(&bytes, &mut encoded).unwrap();
                let (&mut zero, encoded) = encoded[..end].split_last_mut().unwrap();
                assert!(zero == 0 && !encoded.contains(&0), "{len} bytes, zeros at {zeros:?}");
                let decoded = cobs::decode_in_place(encoded).unwrap();
                assert_eq!(&encoded[..decoded], bytes, "zeros at {zeros:?}");
                assert_eq!(encode(&bytes, &mut vec![0; end - 1]), None);
            }
        }
    }
}
