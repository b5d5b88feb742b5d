//! The readout of a frame, line by line.

use multiscopic_core::Frame;

use super::{
    configuration::Size,
    line_queue::{Arrival, PixelBus},
};

/// A frame that is being read out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Readout {
    pub frame: Frame,
    /// True if the frame is matched during readout instead of being stored.
    pub is_streamed: bool,
    /// The next line of the sensor, border included.
    pub next: usize,
    pub has_ended: bool,
    /// Sticky: a damaged frame stays damaged.
    pub defect: Option<FrameDefect>,
}

/// A line, or the end of a frame, from the sensor.
pub(super) enum SensorOutput<'a> {
    /// A line of the sensor's border.
    Border,
    /// A line of the frame: its number and its pixels, without the border.
    Line(usize, &'a [u8]),
    /// The end of the frame.
    End,
}

/// A fault of a frame. Lines count from the top of the sensor, border included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FrameDefect {
    Lost { line: usize },
    Torn { lines: usize },
    Line { line: usize, pixels: usize },
}

impl Readout {
    /// The readout of `frame`, which has not begun.
    pub fn new(frame: Frame, is_streamed: bool) -> Readout {
        Readout { frame, is_streamed, next: 0, has_ended: false, defect: None }
    }

    /// Takes the next line or the end of the frame from the bus, or nothing if neither has arrived yet.
    ///
    /// # Errors
    /// The line is not the next one of the frame, or not of its width; or the frame ended in the wrong place.
    pub fn receive<'b, B: PixelBus>(&mut self, bus: &'b mut B, size: Size) -> Result<Option<SensorOutput<'b>>, FrameDefect> {
        if let Some(defect) = self.defect {
            return Err(defect);
        }
        if self.has_ended {
            return Ok(Some(SensorOutput::End));
        }
        let defect = match bus.next() {
            None => return Ok(None),
            Some(Arrival::Line { number, .. }) if number != self.next => FrameDefect::Lost { line: self.next },
            Some(Arrival::Line { number, pixels }) if pixels.len() == size.columns() && number < size.lines() => {
                self.next += 1;
                let rows = size.border()..size.border() + size.height();
                let line = pixels.get(size.border()..size.border() + size.width());
                return Ok(Some(match line.filter(|_| rows.contains(&number)) {
                    Some(line) => SensorOutput::Line(number - rows.start, line),
                    None => SensorOutput::Border,
                }));
            }
            Some(Arrival::Line { number, pixels }) => FrameDefect::Line { line: number, pixels: pixels.len() },
            Some(Arrival::End { lines }) if lines != size.lines() => FrameDefect::Torn { lines },
            Some(Arrival::End { lines }) if lines != self.next => FrameDefect::Lost { line: self.next },
            Some(Arrival::End { .. }) => {
                self.has_ended = true;
                return Ok(Some(SensorOutput::End));
            }
        };
        self.defect = Some(defect);
        Err(defect)
    }
}
