//! What the firmware sent.

use anyhow::{Context, Result, bail, ensure};
use multiscopic_core::{Disparity, Params};
use multiscopic_edge::packet::{Content, Packet, Receiver};

/// A frame of disparities, put together from packets.
#[derive(Debug)]
pub struct Received {
    /// Line by line.
    pub disparities: Vec<Option<Disparity>>,
    /// The greatest depth of the firmware's stack, in bytes.
    pub stack: usize,
}

impl Received {
    /// The frame in `bytes`. Every pixel must come once, and nothing may be lost or damaged.
    pub fn decode(mut bytes: Vec<u8>, params: &Params) -> Result<Received> {
        let (width, height) = (params.width(), params.height());
        let mut pixels = vec![None; width * height];
        let mut receiver = Receiver::default();
        ensure!(bytes.pop() == Some(0), "the last packet has no end");
        let mut packets = bytes.split_mut(|&byte| byte == 0);
        while let Some(packet) = packets.next() {
            let packet = Packet::decode(packet)?;
            receiver.accept(&packet.header)?;
            let (w, h) = (packet.header.width.into(), packet.header.height.into());
            ensure!((w, h) == (width, height), "a packet of {w}x{h} pixels, expected {width}x{height}");
            match packet.header.content {
                Content::Line { line, left, .. } => {
                    let start = usize::from(line) * width + usize::from(left);
                    for (pixel, disparity) in pixels[start..].iter_mut().zip(packet.disparities()) {
                        ensure!(pixel.replace(disparity).is_none(), "a pixel of line {line} came twice");
                    }
                }
                Content::End { stack } => {
                    ensure!(packets.next().is_none(), "there are packets after the frame's end");
                    let disparities = pixels.into_iter().collect::<Option<_>>().context("pixels are missing")?;
                    return Ok(Received { disparities, stack: stack as usize });
                }
            }
        }
        bail!("the frame has no end")
    }

    /// Fails at the first pixel that differs from `expected`.
    pub fn same_as(&self, expected: &[Option<Disparity>], width: usize) -> Result<()> {
        let show = |pixel: &Option<Disparity>| pixel.map_or("invalid".to_owned(), |disparity| disparity.to_string());
        for (i, (found, expected)) in self.disparities.iter().zip(expected).enumerate() {
            let (u, v) = (i % width, i / width);
            ensure!(found == expected, "pixel ({u}, {v}): the firmware found {}, this machine {}", show(found), show(expected));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Fusion, Region, Views};
    use multiscopic_edge::packet::{Sender, buffer_bytes};

    const PARAMS: Params = match Params::new(3, 2, Views::ALL, Fusion::Min, 1, 4, 3) {
        Ok(params) => params,
        Err(_) => panic!("the parameters are out of range"),
    };

    /// A frame of twos in two tiles, without the packets that `skip` chooses.
    fn sent(skip: impl Fn(usize) -> bool) -> Vec<u8> {
        let mut buffer = vec![0; buffer_bytes(3)];
        let mut sender = Sender::new(&PARAMS, &mut buffer);
        let lines = Region::tiles(&PARAMS, 2).flat_map(|tile| [(tile, 0), (tile, 1)]);
        let two = Disparity::from_bits(128);
        let mut packets: Vec<_> =
            lines.map(|(tile, v)| sender.line(&tile, v, &vec![two; tile.width()]).unwrap().to_vec()).collect();
        packets.push(sender.end(77).unwrap().to_vec());
        packets.into_iter().enumerate().filter(|&(i, _)| !skip(i)).flat_map(|(_, packet)| packet).collect()
    }

    #[test]
    fn tiles_make_a_frame() {
        let received = Received::decode(sent(|_| false), &PARAMS).unwrap();
        assert_eq!(received.stack, 77);
        let mut expected = [Disparity::from_bits(128); 6];
        assert!(received.same_as(&expected, 3).is_ok());
        expected[4] = None;
        let error = received.same_as(&expected, 3).unwrap_err().to_string();
        assert_eq!(error, "pixel (1, 1): the firmware found 2, this machine invalid");
    }

    #[test]
    fn what_is_missing_is_named() {
        let error = |skipped| Received::decode(sent(|i| i == skipped), &PARAMS).unwrap_err().to_string();
        assert_eq!(error(2), "packets were lost: number 2 was expected, number 3 came");
        assert_eq!(error(4), "the frame has no end");
    }
}
