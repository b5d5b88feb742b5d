//! The camera that takes the frames.

/// A camera that takes one frame at a time.
///
/// The implementation decides where frames go: into memory, into a file, or line by line to whoever reads
/// them as they arrive. No call waits for a frame. Each returns within a bounded time.
pub trait Camera {
    /// The reason why there is no frame.
    type Error;

    /// Prepares for a sequence: holds exposure, gain and focus, so that frames can be compared.
    ///
    /// # Errors
    /// The camera does not take the settings.
    fn begin(&mut self) -> Result<(), Self::Error>;

    /// Starts to take the frame with this index in the sequence, in place of any frame under way. Nothing
    /// exposed before the call may be part of the frame.
    ///
    /// # Errors
    /// The camera cannot start.
    fn start(&mut self, index: usize) -> Result<(), Self::Error>;

    /// Returns true if the whole frame is there. Called repeatedly; each call may do a part of the work.
    ///
    /// # Errors
    /// The frame is damaged or unusable, or the camera does not answer.
    fn is_complete(&mut self) -> Result<bool, Self::Error>;

    /// Drops any frame under way and releases the settings that [`begin`](Camera::begin) held. Called once
    /// after each sequence, however it ended.
    ///
    /// # Errors
    /// The camera does not answer.
    fn end(&mut self) -> Result<(), Self::Error>;
}
