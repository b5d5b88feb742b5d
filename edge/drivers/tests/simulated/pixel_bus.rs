//! The pixel bus of a simulated sensor, whose edges are not where they should be.

use multiscopic_drivers::hm01b0::DataLines;

/// A cycle of the microcontroller in units of time, so that edges fall between cycles.
pub const CYCLE: i64 = 32;

/// The levels of the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    pub clock: bool,
    pub line_valid: bool,
    pub data: u8,
}

/// A change of a level.
#[derive(Clone, Copy, Debug)]
enum Edge {
    Clock(bool),
    LineValid(bool),
    Data(u8),
}

/// The bus of a sensor.
#[derive(Clone, Copy, Debug)]
pub struct PixelBus {
    pub data_lines: DataLines,
    pub columns: usize,
    pub lines: usize,
    /// The time of a pixel clock. It falls at its end.
    pub period: i64,
    /// The time between lines.
    pub blanking: i64,
    pub idle_clock: IdleClock,
    /// LVLD's changes at the start and at the end of a line, counted from the fall of the clock.
    pub rise: i64,
    pub fall: i64,
    /// The most that an edge of the clock is early or late.
    pub jitter: i64,
    /// The time of the first edge.
    pub phase: i64,
    pub fault: Option<Fault>,
}

/// The clock between lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IdleClock {
    /// It runs on.
    Running,
    /// It stays low until half a clock after the line begins.
    Low,
    /// It stays high after a line.
    High,
}

/// A fault at a clock of a line.
#[derive(Clone, Copy, Debug)]
pub struct Fault {
    pub line: usize,
    pub clock: usize,
    pub kind: FaultKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The clock does not come.
    MissingClock,
    /// The clock comes twice.
    DoubledClock,
    /// LVLD falls for the time of a clock.
    InterruptedLine,
}

impl PixelBus {
    /// A pixel.
    pub fn pixel(&self, line: usize, column: usize) -> u8 {
        (line * 89 + column * 37 + 0x5a) as u8 ^ (column >> 3) as u8
    }

    /// The pixels of a line.
    pub fn line(&self, line: usize) -> Vec<u8> {
        (0..self.columns).map(|column| self.pixel(line, column)).collect()
    }

    /// The data lines at a clock of a line: the highest bits of a pixel come first.
    fn data(&self, line: usize, clock: usize) -> u8 {
        let clocks = self.data_lines.clocks();
        let shift = (clocks - 1 - clock % clocks) * self.data_lines.count();
        self.pixel(line, clock / clocks) >> shift & ((1_u16 << self.data_lines.count()) - 1) as u8
    }

    /// The levels at the start of each cycle.
    pub fn levels(&self) -> Vec<Levels> {
        let edges = self.edges();
        let end = edges.last().map_or(0, |&(time, _)| time) + self.blanking;
        let (mut levels, mut edges) = (Levels::default(), edges.into_iter().peekable());
        (0..end / CYCLE)
            .map(|cycle| {
                while let Some((_, edge)) = edges.next_if(|&(time, _)| time <= cycle * CYCLE) {
                    match edge {
                        Edge::Clock(level) => levels.clock = level,
                        Edge::LineValid(level) => levels.line_valid = level,
                        Edge::Data(data) => levels.data = data,
                    }
                }
                levels
            })
            .collect()
    }

    /// All edges with their times, in order.
    fn edges(&self) -> Vec<(i64, Edge)> {
        let mut random = 1_u32;
        let mut jitter = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i64::from(random >> 16) % (2 * self.jitter + 1) - self.jitter
        };
        let clocks = self.columns * self.data_lines.clocks();
        let blank = (self.blanking / self.period) as usize;
        let mut edges = vec![(0, Edge::Clock(self.idle_clock == IdleClock::High))];
        for clock in 0..self.lines * (blank + clocks) + blank {
            let start = self.phase + clock as i64 * self.period;
            let (line, active) = (clock / (blank + clocks), (clock % (blank + clocks)).checked_sub(blank));
            let fault = self.fault.filter(|fault| fault.line == line && Some(fault.clock) == active).map(|fault| fault.kind);
            if active == Some(0) {
                edges.push((start + self.rise, Edge::LineValid(true)));
            }
            if active == Some(clocks - 1) {
                edges.push((start + self.period + self.fall, Edge::LineValid(false)));
            }
            // The data change with the fall of the clock before, and need a moment.
            edges.push((start + jitter(), Edge::Data(jitter() as u8)));
            let data = active.map_or(0xa5, |active| self.data(line, active));
            edges.push((start + self.jitter + 2 * CYCLE, Edge::Data(data)));
            let mut pulse = |edges: &mut Vec<_>, rise: i64, fall: i64| {
                edges.push((start + rise + jitter(), Edge::Clock(true)));
                edges.push((start + fall + jitter(), Edge::Clock(false)));
            };
            match fault {
                Some(FaultKind::MissingClock) => {}
                Some(FaultKind::DoubledClock) => {
                    pulse(&mut edges, self.period / 4, self.period / 2);
                    pulse(&mut edges, self.period * 3 / 4, self.period);
                }
                None | Some(FaultKind::InterruptedLine) => match self.idle_clock {
                    IdleClock::Running => pulse(&mut edges, self.period / 2, self.period),
                    IdleClock::Low if active.is_some() => pulse(&mut edges, self.period / 2, self.period),
                    IdleClock::High if active.is_some() => pulse(&mut edges, self.period / 2, 0),
                    IdleClock::Low | IdleClock::High => {}
                },
            }
            if fault == Some(FaultKind::InterruptedLine) {
                edges.push((start, Edge::LineValid(false)));
                edges.push((start + self.period, Edge::LineValid(true)));
            }
        }
        edges.sort_by_key(|&(time, _)| time);
        edges
    }
}
