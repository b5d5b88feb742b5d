//! A person who moves the camera.

use std::{
    io::{self, BufRead, BufReader, IsTerminal, Read, Write},
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        mpsc::{self, Receiver, TryRecvError},
    },
    thread,
};

use multiscopic_core::capture::{Position, Stage};

use super::{Limits, StageError};

/// A stage that asks a person to move the camera, and takes an empty line for done; `q` gives up.
///
/// It cannot tell where the camera is, and moves nothing by itself. No call waits for an answer, so that a capture can be given up at any time.
pub struct Manual<W> {
    answers: Answers,
    prompts: W,
    limits: Limits,
    /// Where the camera was put, if it is known.
    place: Option<Position>,
    /// Where it is asked to be put.
    target: Option<Position>,
}

impl Manual<io::Stderr> {
    /// Asks on standard error, and reads answers from standard input.
    ///
    /// # Errors
    /// The limits are out of range.
    pub fn at_terminal(limits: &Limits) -> Result<Self, StageError> {
        // Only one reader, for ever: another would take a line that an earlier one still waits for.
        static ANSWERS: OnceLock<Answers> = OnceLock::new();
        let answers = ANSWERS.get_or_init(|| Answers::of(io::stdin(), io::stdin().is_terminal())).clone();
        limits.check()?;
        Ok(Manual { answers, prompts: io::stderr(), limits: *limits, place: None, target: None })
    }
}

impl<W: Write> Manual<W> {
    /// Asks on `prompts`, and reads answers from `answers`, a line each.
    ///
    /// # Errors
    /// The limits are out of range.
    pub fn new(answers: impl Read + Send + 'static, prompts: W, limits: &Limits) -> Result<Self, StageError> {
        limits.check()?;
        Ok(Manual { answers: Answers::of(answers, false), prompts, limits: *limits, place: None, target: None })
    }
}

impl<W: Write> Stage for Manual<W> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.admit(position)?;
        self.target = Some(position);
        if self.place == self.target {
            return Ok(());
        }
        self.answers.forget();
        let order = match self.place {
            Some(place) => format!("Move the camera {}", describe(place, position)),
            None if position == Position::CENTER => "Put the camera where the centre image is taken".into(),
            None => format!("Put the camera {} from where the centre image is taken", describe(Position::CENTER, position)),
        };
        let asked =
            writeln!(self.prompts, "{order} and press Enter (q and Enter to give up)").and_then(|()| self.prompts.flush());
        asked.map_err(StageError::Terminal)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        let Some(target) = self.target else { return Ok(false) };
        if self.place == Some(target) {
            return Ok(true);
        }
        match self.answers.next().map_err(StageError::Terminal)? {
            Some(answer) if answer.trim().is_empty() => {
                self.place = Some(target);
                Ok(true)
            }
            Some(answer) if answer.trim().eq_ignore_ascii_case("q") => Err(StageError::GivenUp),
            _ => Ok(false),
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        Ok(None)
    }

    fn stop(&mut self) -> Result<(), StageError> {
        // It is not known whether the camera was moved by then.
        if self.place != self.target {
            self.place = None;
        }
        self.target = None;
        Ok(())
    }
}

/// The way from a position to another, in words.
fn describe(from: Position, to: Position) -> String {
    let step = |distance: i64, less: &str, more: &str| {
        let side = if distance < 0 { less } else { more };
        (distance != 0).then(|| format!("{:.1} mm {side}", distance.unsigned_abs() as f64 / 1e3))
    };
    let across = step(i64::from(to.x_um) - i64::from(from.x_um), "to the left", "to the right");
    let down = step(i64::from(to.y_um) - i64::from(from.y_um), "up", "down");
    across.into_iter().chain(down).collect::<Vec<_>>().join(" and ")
}

/// The lines that a person typed, read by a thread.
#[derive(Clone)]
struct Answers {
    lines: Arc<Mutex<Receiver<io::Result<String>>>>,
    /// Whether a line typed before a question is no answer. It is one where no person types.
    is_typed: bool,
}

impl Answers {
    fn of(source: impl Read + Send + 'static, is_typed: bool) -> Answers {
        let (sender, lines) = mpsc::channel();
        thread::spawn(move || BufReader::new(source).lines().try_for_each(|line| sender.send(line)));
        Answers { lines: Arc::new(Mutex::new(lines)), is_typed }
    }

    /// Drops what was typed too early.
    fn forget(&self) {
        while self.is_typed && matches!(self.next(), Ok(Some(_))) {}
    }

    /// The next line, if there is one by now.
    fn next(&self) -> io::Result<Option<String>> {
        match self.lines.lock().unwrap_or_else(PoisonError::into_inner).try_recv() {
            Ok(line) => line.map(Some),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the input has ended")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    /// A person whose answers are sent by a test.
    struct Person(Receiver<&'static str>);

    impl Read for Person {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let Ok(text) = self.0.recv() else { return Ok(0) };
            buffer[..text.len()].copy_from_slice(text.as_bytes());
            Ok(text.len())
        }
    }

    fn at(x_um: i32, y_um: i32) -> Position {
        Position { x_um, y_um }
    }

    fn arrival(stage: &mut impl Stage<Error = StageError>) -> Result<(), StageError> {
        let start = Instant::now();
        while !stage.has_arrived()? {
            assert!(start.elapsed() < Duration::from_secs(5), "the answer does not come");
            thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    #[test]
    fn a_person_is_asked() {
        let (person, answers) = mpsc::channel();
        let mut prompts = Vec::new();
        let mut stage = Manual::new(Person(answers), &mut prompts, &Limits::default()).unwrap();
        for position in [at(0, 0), at(-20_000, 0), at(0, 1500), at(0, 1500)] {
            stage.move_to(position).unwrap();
            if stage.place != stage.target {
                assert!(!stage.has_arrived().unwrap(), "nobody has answered");
                person.send("not yet\n").unwrap();
                assert!(!stage.has_arrived().unwrap(), "this is no answer");
                person.send("\n").unwrap();
            }
            arrival(&mut stage).unwrap();
            assert_eq!(stage.position().unwrap(), None);
        }
        // Where it is after a move that was given up is not known.
        stage.move_to(at(5000, 0)).unwrap();
        stage.stop().unwrap();
        assert!(!stage.has_arrived().unwrap());
        stage.move_to(at(0, -5000)).unwrap();
        drop(person);
        assert!(matches!(arrival(&mut stage), Err(StageError::Terminal(_))));
        let prompts = String::from_utf8(prompts).unwrap();
        let expected = [
            "Put the camera where the centre image is taken",
            "Move the camera 20.0 mm to the left",
            "Move the camera 20.0 mm to the right and 1.5 mm down",
            "Move the camera 5.0 mm to the right and 1.5 mm up",
            "Put the camera 5.0 mm up from where the centre image is taken",
        ];
        let expected: Vec<_> = expected.iter().map(|order| format!("{order} and press Enter (q and Enter to give up)")).collect();
        assert_eq!(prompts.lines().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn answers_may_come_from_a_pipe() {
        let mut stage = Manual::new(&b"\r\n\nq\n"[..], io::sink(), &Limits::default()).unwrap();
        for x_um in [0, 1000] {
            stage.move_to(at(x_um, 0)).unwrap();
            arrival(&mut stage).unwrap();
        }
        stage.move_to(at(0, 0)).unwrap();
        assert!(matches!(arrival(&mut stage), Err(StageError::GivenUp)));
        assert!(matches!(stage.move_to(at(0, 100_001)), Err(StageError::OutOfReach { .. })));
    }
}
