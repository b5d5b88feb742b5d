//! The program that samples the pixel bus on the Pico 2, in a model of the state machine, with a sensor whose edges move.

#[path = "../../pico2/src/line_format.rs"]
mod line_format;
#[path = "simulated/pixel_bus.rs"]
mod pixel_bus;
#[path = "simulated/state_machine.rs"]
mod state_machine;

use std::mem;

use embedded_hal_mock::eh1::{
    delay::NoopDelay,
    i2c::{Mock, Transaction},
};
use line_format::{EXTRA, PINS, last_clock, pixels};
use multiscopic_core::{
    BlockMatchingParams, Frame, ScanlineSource, SearchConfig,
    capture::{Camera, Plan},
    valid,
};
use multiscopic_drivers::hm01b0::{Configuration, DataLines, FrameMemory, Hm01b0, Hm01b0Error, LineQueue, LineSender, Size};
use pixel_bus::{CYCLE, Fault, FaultKind, IdleClock, Levels, PixelBus};
use state_machine::{Program, StateMachine};

/// The program that the firmware assembles.
const PROGRAM: &str = include_str!("../../pico2/src/lines.pio");
/// The program that it replaced. D0 is the first pin.
const FORMER_PROGRAM: &str = "
    .wrap_target
        wait 1 pin 9
        wait 1 pin 8
        in pins, 8
        wait 0 pin 8
    .wrap";

/// The cycles that DMA takes for a byte.
const DMA_CYCLES: usize = 6;
/// The cycles that the processor takes until it asks for the next line.
const PAUSE: usize = 80;

/// The bus at the clocks of the board: 150 MHz for the microcontroller, and 12 MHz for the sensor, which divides them by 4, or
/// by 8 with one data line.
fn bus(data_lines: DataLines) -> PixelBus {
    let period = match data_lines {
        DataLines::Eight => 50 * CYCLE,
        DataLines::Four => 25 * CYCLE,
        DataLines::One => 25 * CYCLE / 2,
    };
    PixelBus {
        data_lines,
        columns: 6,
        lines: 3,
        period,
        blanking: 200 * CYCLE,
        idle_clock: IdleClock::Low,
        rise: 0,
        fall: 0,
        jitter: 0,
        phase: 0,
        fault: None,
    }
}

/// Calls `test` with every alignment of the bus whose edges are within `reach` cycles of the clock's.
fn for_each_alignment(data_lines: DataLines, reach: i64, mut test: impl FnMut(PixelBus)) {
    let bus = bus(data_lines);
    for idle_clock in [IdleClock::Running, IdleClock::Low, IdleClock::High] {
        for cycles in -reach..=reach {
            for [rise, fall] in [[cycles, cycles], [cycles, -cycles]] {
                for (phase, jitter) in [(0, 0), (CYCLE * 5 / 8, bus.period / 64), (CYCLE / 4, bus.period / 32)] {
                    test(PixelBus { idle_clock, rise: rise * CYCLE, fall: fall * CYCLE, phase, jitter, ..bus });
                }
            }
        }
    }
}

/// A line that DMA has received.
struct Sampled {
    bytes: Vec<u8>,
    /// The number of its pixels, as the firmware counts them.
    pixels: usize,
}

/// The lines that DMA receives with the program of the firmware, which starts after `start` cycles. The processor takes `pause`
/// cycles until it asks for the next one.
fn sample(bus: &PixelBus, start: usize, pause: usize) -> Vec<Sampled> {
    let program = Program::assemble(PROGRAM, &[("DATA_LINES", bus.data_lines.count() as u32)]);
    let mut machine = StateMachine::new(&program, PINS as u32, program.symbol("start").expect("a start"));
    let request = last_clock(bus.columns, bus.data_lines);
    machine.sent.push_back(request);
    let (mut lines, mut bytes, mut wait) = (Vec::new(), Vec::new(), 0);
    for levels in bus.levels().into_iter().skip(start) {
        machine.step(u32::from(levels.clock) | u32::from(levels.line_valid) << 1 | u32::from(levels.data) << 2);
        if wait > 0 {
            wait -= 1;
        } else if bytes.len() == bus.columns + EXTRA {
            let bytes = mem::take(&mut bytes);
            lines.push(Sampled { pixels: pixels(&bytes, bus.columns, bus.data_lines), bytes });
            machine.sent.push_back(request);
        } else if let Some(word) = machine.received.pop_front() {
            bytes.push(word as u8);
            wait = if bytes.len() == bus.columns + EXTRA { pause } else { DMA_CYCLES };
        }
    }
    lines
}

/// The pixels that the former program takes, if the state machine sees as many pins.
fn sample_as_before(bus: &PixelBus, visible: u32) -> Vec<u8> {
    let program = Program::assemble(FORMER_PROGRAM, &[]);
    let mut machine = StateMachine::new(&program, visible, 0);
    let pins = |levels: Levels| u32::from(levels.data) | u32::from(levels.clock) << 8 | u32::from(levels.line_valid) << 9;
    let step = |levels| {
        machine.step(pins(levels));
        machine.received.pop_front().map(|word| word as u8)
    };
    bus.levels().into_iter().filter_map(step).collect()
}

/// Asserts that a sampled line is line `number` of the sensor.
#[track_caller]
fn assert_whole(bus: &PixelBus, number: usize, line: &Sampled) {
    assert_eq!(line.pixels, bus.columns, "line {number} of {bus:?}");
    assert_eq!(line.bytes[..bus.columns], bus.line(number), "line {number} of {bus:?}");
}

#[test]
fn lines_have_their_pixels_at_every_alignment() {
    // Up to some cycles less than half a clock.
    for (data_lines, reach) in [(DataLines::Eight, 18), (DataLines::Four, 6), (DataLines::One, 1)] {
        for_each_alignment(data_lines, reach, |bus| {
            let lines = sample(&bus, 0, PAUSE);
            assert_eq!(lines.len(), bus.lines, "{bus:?}");
            lines.iter().enumerate().for_each(|(number, line)| assert_whole(&bus, number, line));
        });
    }
}

#[test]
fn lines_of_the_sensor_fit() {
    for data_lines in [DataLines::Eight, DataLines::Four, DataLines::One] {
        let bus = PixelBus { columns: 324, lines: 2, jitter: CYCLE, ..bus(data_lines) };
        let lines = sample(&bus, 0, PAUSE);
        assert_eq!(lines.len(), 2);
        lines.iter().enumerate().for_each(|(number, line)| assert_whole(&bus, number, line));
    }
}

#[test]
fn the_former_program_takes_pixels_between_lines() {
    let (mut exact, mut surplus) = (0, 0);
    for_each_alignment(DataLines::Eight, 18, |bus| {
        // It passes as well, but that is not what the sensor does.
        if bus.idle_clock == IdleClock::High {
            return;
        }
        let pixels = sample_as_before(&bus, 10);
        let expected: Vec<u8> = (0..bus.lines).flat_map(|line| bus.line(line)).collect();
        if pixels == expected {
            exact += 1;
        } else {
            assert!(bus.idle_clock == IdleClock::Running && pixels.len() > expected.len(), "{bus:?}");
            surplus += 1;
        }
    });
    assert!(exact > 0 && surplus > 0, "{exact} and {surplus}");
}

#[test]
fn the_former_program_waits_for_pins_that_were_masked() {
    // The HAL showed it the data lines alone.
    assert_eq!(sample_as_before(&bus(DataLines::Eight), 8), []);
}

#[test]
fn a_damaged_line_is_reported_and_the_next_ones_are_whole() {
    use FaultKind::{DoubledClock, MissingClock};
    for data_lines in [DataLines::Eight, DataLines::Four] {
        for idle_clock in [IdleClock::Running, IdleClock::Low] {
            for (kind, clock) in [(MissingClock, 0), (MissingClock, 3), (MissingClock, 5), (DoubledClock, 0), (DoubledClock, 5)] {
                let fault = Some(Fault { line: 1, clock, kind });
                let bus = PixelBus { idle_clock, fault, jitter: CYCLE / 2, ..bus(data_lines) };
                let lines = sample(&bus, 0, PAUSE);
                assert_eq!(lines.len(), bus.lines, "{bus:?}");
                let expected = if kind == MissingClock { bus.columns - 1 } else { bus.columns + 1 };
                assert_eq!(lines[1].pixels, expected, "{bus:?}");
                [0, 2].into_iter().for_each(|number| assert_whole(&bus, number, &lines[number]));
            }
        }
    }
}

#[test]
fn an_interrupted_line_is_too_short() {
    for (columns, clock) in [(6, 2), (324, 10), (324, 300)] {
        let fault = Some(Fault { line: 1, clock, kind: FaultKind::InterruptedLine });
        let bus = PixelBus { fault, columns, ..bus(DataLines::Eight) };
        let lines = sample(&bus, 0, 20);
        assert_eq!(lines[1].pixels, clock);
        // The rest is a line too, or comes too early.
        let rest: Vec<usize> = lines[2..lines.len() - 1].iter().map(|line| line.pixels).collect();
        assert!(rest == [columns - clock - 1] || rest.is_empty(), "{rest:?}");
        assert_whole(&bus, 0, &lines[0]);
        assert_whole(&bus, 2, &lines[lines.len() - 1]);
    }
}

#[test]
fn a_program_that_starts_within_a_line_takes_the_next_one() {
    let bus = bus(DataLines::Eight);
    let first = bus.levels().iter().position(|levels| levels.line_valid).expect("a line");
    for start in (first + 5..first + 280).step_by(5) {
        let lines = sample(&bus, start, PAUSE);
        assert_eq!(lines.len(), bus.lines - 1, "from cycle {start}");
        lines.iter().zip(1..).for_each(|(line, number)| assert_whole(&bus, number, line));
    }
}

#[test]
fn a_late_processor_loses_whole_lines() {
    let bus = bus(DataLines::Eight);
    let mut lost = 0;
    for pause in (0..1500).step_by(10) {
        let lines = sample(&bus, 0, pause);
        let numbers = lines.iter().map(|line| {
            let number = (0..bus.lines).find(|&number| bus.line(number) == line.bytes[..bus.columns]).expect("a line");
            assert_whole(&bus, number, line);
            number
        });
        assert!(numbers.is_sorted(), "after {pause} cycles");
        lost += bus.lines.saturating_sub(lines.len());
    }
    assert!(lost > 50, "{lost}");
}

/// Sends a frame as the firmware does.
fn send_frame(sender: &mut LineSender<'_, '_>, bus: &PixelBus) {
    sender.begin_frame();
    for line in sample(bus, 0, PAUSE) {
        if let Some(buffer) = sender.buffer() {
            buffer.copy_from_slice(&line.bytes[..bus.columns]);
        }
        sender.end_line(line.pixels);
    }
    sender.end_frame();
}

#[test]
fn a_frame_with_a_damaged_line_is_taken_again() {
    const PARAMS: BlockMatchingParams = valid(SearchConfig::of_size(160, 120).block_matching(7));
    let size = Size::Qqvga;
    // A clock of 12 MHz.
    let (columns, lines, period) = (size.columns(), size.lines(), 25 * CYCLE / 2);
    let whole = PixelBus { columns, lines, period, jitter: period / 32, ..bus(DataLines::Eight) };
    let (mut buffers, mut queue, mut pixels) = (vec![vec![0; columns]; 130], LineQueue::<132>::new(), [0; 160 * 120]);
    let (mut sender, receiver) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
    let start = [0, 3].map(|mode| Transaction::write(0x24, vec![0x01, 0x00, mode]));
    let mut i2c = Mock::new(&[start.clone(), start.clone(), start].concat());
    let (store, settings) = (FrameMemory::new(&PARAMS, &mut pixels), Configuration::new(size));
    let plan = Plan::new(PARAMS.views(), 20_000);
    let mut camera = Hm01b0::new(i2c.clone(), NoopDelay::new(), receiver, store, settings, plan);

    for (kind, found) in [(FaultKind::MissingClock, columns - 1), (FaultKind::DoubledClock, columns + 1)] {
        camera.start(0).expect("a start");
        send_frame(
            &mut sender,
            &PixelBus { fault: Some(Fault { line: 2, clock: 80, kind }), lines: 4, period: 50 * CYCLE, ..whole },
        );
        assert_eq!(camera.is_complete(), Err(Hm01b0Error::Line { line: 2, pixels: found }));
    }
    camera.start(0).expect("a start");
    send_frame(&mut sender, &whole);
    assert_eq!(camera.is_complete(), Ok(true));
    let mut line = [0; 160];
    for v in 0..120 {
        camera.read_line(Frame::Center, v, &mut line).expect("a line");
        assert_eq!(line[..], whole.line(v + 1)[1..161], "line {v}");
    }
    i2c.done();
}

#[test]
fn every_number_of_clocks_is_counted() {
    for data_lines in [DataLines::Eight, DataLines::Four, DataLines::One] {
        let (columns, clocks) = (324, 324 * data_lines.clocks());
        for sampled in 0..=clocks + data_lines.clocks() {
            let room = (last_clock(columns, data_lines) as u16).wrapping_sub(sampled as u16).to_le_bytes();
            let line = [&[0; 325][..], &room].concat();
            let found = pixels(&line, columns, data_lines);
            assert_eq!(found.cmp(&columns), sampled.cmp(&clocks), "{sampled} of {clocks} clocks");
        }
    }
}
