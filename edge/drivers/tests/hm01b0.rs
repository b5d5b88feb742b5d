//! The camera, on a mocked I2C bus, with lines that arrive intact, damaged or not at all.

use core::iter;
use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource};
use embedded_hal_mock::eh1::{
    delay::{CheckedDelay, NoopDelay, Transaction as Wait},
    i2c::{Mock, Transaction},
};
use multiscopic_core::{
    BlockMatchingParams, Frame, Fusion, MatchError, Matcher, ScanlineSource, SearchConfig, View, Views,
    capture::{Camera, Plan},
    valid,
};
use multiscopic_drivers::hm01b0::{
    Arrival, ClockDivider, Configuration, DataLines, FrameMemory, Gain, Hm01b0, Hm01b0Error, LineQueue, LineSender, NoRoom,
    PixelBus, Size,
};

const SEARCH: SearchConfig =
    SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SearchConfig::of_size(160, 120) };
const PARAMS: BlockMatchingParams = valid(SEARCH.block_matching(7));
const LEFT: Frame = Frame::View(View::LEFT);
const RIGHT: Frame = Frame::View(View::RIGHT);
const NO_RESPONSE: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);

fn plan() -> Plan {
    Plan::new(PARAMS.views(), 20_000)
}

fn write(register: u16, value: u8) -> Transaction {
    let [high, low] = register.to_be_bytes();
    Transaction::write(0x24, vec![high, low, value])
}

fn read(register: u16, value: u8) -> Transaction {
    Transaction::write_read(0x24, register.to_be_bytes().to_vec(), vec![value])
}

/// The transactions of `begin` for 160x120 pixels, 200 lines of exposure, a gain of 4 and a clock divided by
/// 8.
fn begin_transactions() -> Vec<Transaction> {
    let mut bus = vec![read(0x0000, 0x01), read(0x0001, 0xb0), write(0x0103, 1), read(0x0100, 0xff), read(0x0100, 0)];
    let settings = [
        (0x0100, 0),
        (0x3059, 0x02),
        (0x3065, 0x04),
        (0x0383, 3),
        (0x0387, 3),
        (0x0390, 3),
        (0x3010, 1),
        (0x3060, 0x28),
        (0x2100, 0),
        (0x0205, 0x20),
        (0x3020, 1),
        (0x0342, 0),
        (0x0343, 215),
        (0x0340, 0),
        (0x0341, 202),
        (0x0202, 0),
        (0x0203, 200),
        (0x0104, 1),
    ];
    bus.extend(settings.map(|(register, value)| write(register, value)));
    bus
}

fn configuration() -> Configuration {
    Configuration {
        exposure_lines: 200,
        gain: Gain::X4,
        clock: ClockDivider::By8,
        line_clocks: 0,
        ..Configuration::new(Size::Qqvga)
    }
}

fn start_transactions() -> [Transaction; 2] {
    [write(0x0100, 0), write(0x0100, 3)]
}

fn end_transactions() -> [Transaction; 2] {
    [write(0x0100, 0), write(0x2100, 1)]
}

/// A bus on which no line ever arrives.
struct SilentBus;

impl PixelBus for SilentBus {
    fn restart(&mut self) {}

    fn next(&mut self) -> Option<Arrival<'_>> {
        None
    }
}

#[test]
fn exposure_is_fixed_from_begin_to_end() {
    let expected: Vec<_> = begin_transactions().into_iter().chain(start_transactions()).chain(end_transactions()).collect();
    let (mut i2c, mut delay) = (Mock::new(&expected), CheckedDelay::new(&[Wait::delay_ms(1), Wait::delay_ms(1)]));
    let mut pixels = [];
    let store = FrameMemory::new(&PARAMS, &mut pixels);
    let mut camera = Hm01b0::new(i2c.clone(), delay.clone(), SilentBus, store, configuration(), plan());
    assert_eq!(camera.begin(), Ok(()));
    assert_eq!(camera.is_complete(), Ok(false));
    assert_eq!(camera.start(3), Err(Hm01b0Error::NoFrame { index: 3 }));
    assert_eq!(camera.start(0), Ok(()));
    assert_eq!(camera.is_complete(), Ok(false));
    assert_eq!(camera.end(), Ok(()));
    drop(camera.release());
    i2c.done();
    delay.done();
}

#[test]
fn a_qvga_frame_sets_its_own_registers() {
    let mut expected = vec![read(0x0000, 0x01), read(0x0001, 0xb0), write(0x0103, 1), read(0x0100, 0)];
    let settings = [
        (0x0100, 0),
        (0x3059, 0x02),
        (0x3065, 0x04),
        (0x0383, 1),
        (0x0387, 1),
        (0x0390, 0),
        (0x3010, 1),
        (0x3060, 0x29),
        (0x2100, 0),
        (0x0205, 0),
        (0x3020, 1),
        (0x0342, 0x03),
        (0x0343, 0xe8),
        (0x0340, 0x01),
        (0x0341, 0x04),
        (0x0202, 0),
        (0x0203, 122),
        (0x0104, 1),
    ];
    expected.extend(settings.map(|(register, value)| write(register, value)));
    let mut i2c = Mock::new(&expected);
    let settings = Configuration { line_clocks: 1000, ..Configuration::new(Size::Qvga) };
    let mut camera = Hm01b0::new(i2c.clone(), NoopDelay::new(), SilentBus, FrameMemory::new(&PARAMS, &mut []), settings, plan());
    assert_eq!(camera.begin(), Ok(()));
    i2c.done();
}

#[test]
fn a_bus_of_fewer_lines_is_set_and_limits_the_clock() {
    let eight = Configuration { clock: ClockDivider::By1, ..configuration() };
    for (data_lines, bus, clock) in [(DataLines::Eight, 0x02, 0x2b), (DataLines::Four, 0x42, 0x3a), (DataLines::One, 0x22, 0x38)]
    {
        let mut expected = begin_transactions();
        let registers = [(0x3059, 0x02, bus), (0x3060, 0x28, clock)];
        for (register, old, new) in registers {
            let place = expected.iter().position(|transaction| *transaction == write(register, old)).unwrap();
            expected[place] = write(register, new);
        }
        let mut i2c = Mock::new(&expected);
        let settings = Configuration { data_lines, ..eight };
        let mut camera =
            Hm01b0::new(i2c.clone(), NoopDelay::new(), SilentBus, FrameMemory::new(&PARAMS, &mut []), settings, plan());
        assert_eq!(camera.begin(), Ok(()));
        i2c.done();
    }
}

#[test]
fn every_failed_transaction_is_reported() {
    let all: Vec<_> = begin_transactions().into_iter().chain(start_transactions()).chain(end_transactions()).collect();
    for failing in 0..all.len() {
        let mut expected = all[..=failing].to_vec();
        expected[failing] = expected[failing].clone().with_error(NO_RESPONSE);
        let mut i2c = Mock::new(&expected);
        let store = FrameMemory::new(&PARAMS, &mut []);
        let mut camera = Hm01b0::new(i2c.clone(), NoopDelay::new(), SilentBus, store, configuration(), plan());
        let result = camera.begin().and_then(|()| camera.start(0)).and_then(|()| camera.end());
        assert_eq!(result, Err(Hm01b0Error::I2c(NO_RESPONSE)), "transaction {failing}");
        i2c.done();
    }
}

#[test]
fn another_model_and_a_sensor_that_does_not_reset_are_refused() {
    let other = vec![read(0x0000, 0x03), read(0x0001, 0x60)];
    let never: Vec<_> = [read(0x0000, 0x01), read(0x0001, 0xb0), write(0x0103, 1)]
        .into_iter()
        .chain(iter::repeat_n(read(0x0100, 1), 20))
        .collect();
    for (expected, error) in [(other, Hm01b0Error::Model { found: 0x0360 }), (never, Hm01b0Error::NotReset)] {
        let mut i2c = Mock::new(&expected);
        let store = FrameMemory::new(&PARAMS, &mut []);
        let mut camera = Hm01b0::new(i2c.clone(), NoopDelay::new(), SilentBus, store, configuration(), plan());
        assert_eq!(camera.begin(), Err(error));
        i2c.done();
    }
}

/// The pixel at `(u, v)` of a frame.
fn pixel(frame: u8, u: usize, v: usize) -> u8 {
    u.wrapping_mul(7).wrapping_add(v.wrapping_mul(13)) as u8 ^ frame
}

/// Sends a line of the sensor, border included.
fn send(sender: &mut LineSender<'_, '_>, frame: u8, number: usize, columns: usize) {
    if let Some(buffer) = sender.buffer() {
        for (x, sample) in buffer[..columns.min(162)].iter_mut().enumerate() {
            *sample = pixel(frame, x.wrapping_sub(1), number.wrapping_sub(1));
        }
    }
    sender.end_line(columns);
}

type Error = Hm01b0Error<NoRoom>;

/// Calls `test` with a camera that was started with the frame of `index`, and the sending end of its lines.
fn with_camera(index: usize, test: impl FnOnce(&mut dyn SourceCamera, &mut LineSender<'_, '_>)) {
    with_starts(index, 1, test);
}

/// Like [`with_camera`], for a test that starts the camera until it was started `starts` times.
fn with_starts(index: usize, starts: usize, test: impl FnOnce(&mut dyn SourceCamera, &mut LineSender<'_, '_>)) {
    let (mut buffers, mut queue) = (vec![[0; 162]; 6], LineQueue::<8>::new());
    let (mut sender, lines) = queue.split(buffers.iter_mut().map(|buffer| &mut buffer[..]));
    let expected: Vec<_> = iter::repeat_n(start_transactions(), starts).flatten().collect();
    let mut i2c = Mock::new(&expected);
    let mut pixels = vec![0; 2 * 160 * 120];
    let store = FrameMemory::new(&PARAMS, &mut pixels);
    let mut camera = Hm01b0::new(i2c.clone(), NoopDelay::new(), lines, store, configuration(), plan());
    camera.start(index).unwrap();
    sender.begin_frame();
    test(&mut camera, &mut sender);
    i2c.done();
}

trait SourceCamera: Camera<Error = Error> + ScanlineSource<Error = Error> {}

impl<C: Camera<Error = Error> + ScanlineSource<Error = Error>> SourceCamera for C {}

#[test]
fn stored_frames_have_no_border() {
    for (index, frame) in [(0, Frame::Center), (1, LEFT)] {
        with_camera(index, |camera, sender| {
            for number in 0..122 {
                send(sender, 3, number, 162);
                assert_eq!(camera.is_complete(), Ok(false));
            }
            sender.end_frame();
            assert_eq!(camera.is_complete(), Ok(true));
            assert_eq!(camera.is_complete(), Ok(true), "the frame stays complete");
            let mut line = [0; 160];
            for v in 0..120 {
                camera.read_line(frame, v, &mut line).unwrap();
                assert!(line.iter().enumerate().all(|(u, &found)| found == pixel(3, u, v)));
            }
            let no_room = Hm01b0Error::Store(NoRoom { frame, line: 120 });
            assert_eq!(camera.read_line(frame, 120, &mut line), Err(no_room));
        });
    }
}

#[test]
fn the_last_frame_is_read_during_readout() {
    with_camera(2, |camera, sender| {
        let mut line = [0; 160];
        assert_eq!(camera.read_line(RIGHT, 0, &mut line), Err(Hm01b0Error::Waiting { line: 0 }));
        for number in 0..122 {
            send(sender, 5, number, 162);
            if (1..121).contains(&number) {
                let v = number - 1;
                camera.read_line(RIGHT, v, &mut line).unwrap();
                assert!(line.iter().enumerate().all(|(u, &found)| found == pixel(5, u, v)));
                let next = camera.read_line(RIGHT, v + 1, &mut line);
                assert!(matches!(next, Err(Hm01b0Error::Waiting { .. })), "{next:?}");
            }
            assert_eq!(camera.is_complete(), Ok(false));
        }
        sender.end_frame();
        assert_eq!(camera.is_complete(), Ok(true));
    });
}

#[test]
fn the_matcher_waits_for_lines_without_blocking() {
    with_camera(2, |mut camera, sender| {
        let mut memory = [0; PARAMS.memory_words()];
        let mut matcher = Matcher::new(&PARAMS, &mut memory).unwrap();
        let (mut line, mut next, mut waits, mut number) = ([None; 160], 0, 0, 0);
        while next < 120 {
            match matcher.next_line(&mut camera, &mut line) {
                Ok(v) => {
                    assert_eq!(v, Some(next));
                    next += 1;
                }
                Err(MatchError::Source(Hm01b0Error::Waiting { .. })) => {
                    waits += 1;
                    send(sender, 0, number, 162);
                    number += 1;
                }
                Err(error) => panic!("{error}"),
            }
        }
        // Only the first line of the border is taken together with another line.
        assert_eq!((waits, number), (121, 121));
        assert_eq!(camera.is_complete(), Ok(false));
        send(sender, 0, 121, 162);
        sender.end_frame();
        assert_eq!(camera.is_complete(), Ok(true));
    });
}

/// Asserts that the camera reports `expected` for the lines that `send_lines` sends.
fn assert_defect(index: usize, send_lines: impl Fn(&mut LineSender<'_, '_>), expected: Error) {
    with_camera(index, |camera, sender| {
        send_lines(sender);
        let mut line = [0; 160];
        if index == 2 {
            // During readout, reading lines reports the defect first, except for a missing end.
            let reported = (0..120).find_map(|v| camera.read_line(RIGHT, v, &mut line).err());
            assert!(reported == Some(expected) || matches!(expected, Hm01b0Error::Torn { .. }), "{reported:?}");
        }
        assert_eq!(camera.is_complete(), Err(expected), "frame {index}");
        assert_eq!(camera.is_complete(), Err(expected), "the frame stays damaged");
    });
}

#[test]
fn damaged_frames_are_reported() {
    for index in [0, 2] {
        // More lines than buffers.
        let burst = |sender: &mut LineSender<'_, '_>| (0..9).for_each(|number| send(sender, 0, number, 162));
        with_camera(index, |camera, sender| {
            burst(sender);
            let mut line = [0; 160];
            if index == 2 {
                for v in 0..5 {
                    camera.read_line(RIGHT, v, &mut line).unwrap();
                }
            } else {
                assert_eq!(camera.is_complete(), Ok(false));
            }
            send(sender, 0, 9, 162);
            if index == 2 {
                // The receiver still holds the buffer of the sixth line; the others are free again.
                assert_eq!(camera.read_line(RIGHT, 5, &mut line), Err(Hm01b0Error::Lost { line: 6 }));
            }
            assert_eq!(camera.is_complete(), Err(Hm01b0Error::Lost { line: 6 }));
        });
        // A frame that ends early, and lines that are too short and too long.
        assert_defect(
            index,
            |sender| {
                (0..3).for_each(|number| send(sender, 0, number, 162));
                sender.end_frame();
            },
            Hm01b0Error::Torn { lines: 3 },
        );
        assert_defect(index, |sender| send(sender, 0, 0, 161), Hm01b0Error::Line { line: 0, pixels: 161 });
        assert_defect(index, |sender| send(sender, 0, 0, 163), Hm01b0Error::Line { line: 0, pixels: 163 });
    }
}

#[test]
fn a_retaken_frame_has_no_lines_of_the_first_attempt() {
    with_starts(0, 2, |camera, sender| {
        (0..3).for_each(|number| send(sender, 9, number, 162));
        assert_eq!(camera.is_complete(), Ok(false));
        (3..5).for_each(|number| send(sender, 9, number, 162));
        camera.start(0).unwrap();
        // The rest of the first attempt still arrives.
        (5..8).for_each(|number| send(sender, 9, number, 162));
        sender.end_frame();
        assert_eq!(camera.is_complete(), Ok(false));
        sender.begin_frame();
        for number in 0..122 {
            send(sender, 1, number, 162);
            assert_eq!(camera.is_complete(), Ok(false));
        }
        sender.end_frame();
        assert_eq!(camera.is_complete(), Ok(true));
        let mut line = [0; 160];
        camera.read_line(Frame::Center, 2, &mut line).unwrap();
        assert_eq!(line[4], pixel(1, 4, 2));
    });
}
