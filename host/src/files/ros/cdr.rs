//! The Common Data Representation, in which ROS 2 sends messages.

/// A message that is being written: little-endian, each number at a multiple of its size.
#[derive(Clone, Debug)]
pub struct Cdr {
    /// Numbers are aligned from here on.
    body: Vec<u8>,
}

impl Cdr {
    /// What comes before the body: plain CDR, little-endian, no options.
    const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

    /// A message without fields yet.
    pub fn new() -> Cdr {
        Cdr { body: Vec::new() }
    }

    /// The message as it is sent.
    pub fn into_bytes(self) -> Vec<u8> {
        [&Self::ENCAPSULATION[..], &self.body].concat()
    }

    /// A byte, or a truth value.
    pub fn u8(&mut self, value: impl Into<u8>) {
        self.body.push(value.into());
    }

    pub fn u32(&mut self, value: u32) {
        self.aligned(value.to_le_bytes());
    }

    pub fn i32(&mut self, value: i32) {
        self.aligned(value.to_le_bytes());
    }

    pub fn f32(&mut self, value: f32) {
        self.aligned(value.to_le_bytes());
    }

    /// An array of a fixed length.
    pub fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.aligned(value.to_le_bytes()));
    }

    /// The length of a sequence whose elements follow.
    pub fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).expect("messages are far shorter than 4 GiB"));
    }

    /// A sequence of bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.length(bytes.len());
        self.body.extend_from_slice(bytes);
    }

    /// A text, which ends in a zero.
    pub fn string(&mut self, text: &str) {
        self.bytes(&[text.as_bytes(), &[0]].concat());
    }

    fn aligned<const SIZE: usize>(&mut self, bytes: [u8; SIZE]) {
        self.body.resize(self.body.len().next_multiple_of(SIZE), 0);
        self.body.extend_from_slice(&bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_lie_at_multiples_of_their_size() {
        let mut cdr = Cdr::new();
        cdr.string("ab");
        cdr.u8(true);
        cdr.u32(7);
        cdr.f64s(&[1.0]);
        cdr.bytes(&[9]);
        let text = [3, 0, 0, 0, b'a', b'b', 0, 1];
        let rest = [7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f, 1, 0, 0, 0, 9];
        // From the body's beginning: the text at 0, the truth value at 7, 7 at 8, padding to 16, 1.0, the sequence at 24.
        assert_eq!(cdr.into_bytes(), [&[0, 1, 0, 0][..], &text, &rest].concat());
    }
}
