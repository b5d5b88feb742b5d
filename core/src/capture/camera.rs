//! What takes the frames.

/// A camera that takes one frame at a time.
///
/// Where frames go is the implementation's business: into memory, into a file, or by the line to who asks for them as they are read out.
/// No call waits for a frame. Each returns within a time that the implementation bounds.
pub trait Camera {
    /// Why there is no frame.
    type Error;

    /// Gets ready for a sequence: fixes exposure, gain and focus, so that frames can be compared.
    ///
    /// # Errors
    /// The camera cannot be set.
    fn begin(&mut self) -> Result<(), Self::Error>;

    /// Starts to take the frame with an index in the sequence, instead of one that it may be taking. Nothing that was exposed before the call
    /// may be part of the frame.
    ///
    /// # Errors
    /// The camera cannot start.
    fn start(&mut self, index: usize) -> Result<(), Self::Error>;

    /// Whether the frame is there, as a whole. It is asked again and again, and may do a part of the work each time.
    ///
    /// # Errors
    /// The frame is damaged or unusable, or the camera does not answer.
    fn is_complete(&mut self) -> Result<bool, Self::Error>;

    /// Gives up what it may be taking, and everything that [`begin`](Camera::begin) fixed. It is called once after each sequence, whatever
    /// became of it.
    ///
    /// # Errors
    /// The camera cannot be told.
    fn end(&mut self) -> Result<(), Self::Error>;
}
