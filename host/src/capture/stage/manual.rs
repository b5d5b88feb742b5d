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

use super::{error::StageError, limits::Limits, posed::PosedStage};

/// A stage that prompts a person to move the camera. An empty line means done; `q` gives up.
///
/// It cannot measure where the camera is. No call waits for an answer, so that a capture can be aborted at
/// any time.
pub struct ManualStage<W> {
    answers: Answers,
    prompts: W,
    limits: Limits,
    /// The camera's position, if it is known.
    current: Option<Position>,
    /// The position that the person was asked to put it at.
    target: Option<Position>,
}

impl ManualStage<io::Stderr> {
    /// Prompts on standard error, and reads answers from standard input.
    ///
    /// # Errors
    /// The limits are out of range.
    pub fn at_terminal(limits: &Limits) -> Result<Self, StageError> {
        // One reader for the whole process: a second one would compete with the first for lines.
        static ANSWERS: OnceLock<Answers> = OnceLock::new();
        let answers = ANSWERS.get_or_init(|| Answers::read_from(io::stdin(), io::stdin().is_terminal())).clone();
        limits.check()?;
        Ok(ManualStage { answers, prompts: io::stderr(), limits: *limits, current: None, target: None })
    }
}

impl<W: Write> ManualStage<W> {
    /// Prompts on `prompts`, and reads answers from `answers`, one per line.
    ///
    /// # Errors
    /// The limits are out of range.
    pub fn new(answers: impl Read + Send + 'static, prompts: W, limits: &Limits) -> Result<Self, StageError> {
        limits.check()?;
        Ok(ManualStage { answers: Answers::read_from(answers, false), prompts, limits: *limits, current: None, target: None })
    }
}

impl<W: Write> Stage for ManualStage<W> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        self.target = Some(position);
        if self.current == self.target {
            return Ok(());
        }
        self.answers.discard_typed();
        let instruction = match self.current {
            Some(current) => format!("Move the camera {}", displacement(current, position)),
            None if position == Position::CENTER => "Put the camera where the centre image is taken".into(),
            None => format!("Put the camera {} from where the centre image is taken", displacement(Position::CENTER, position)),
        };
        let prompted =
            writeln!(self.prompts, "{instruction} and press Enter (q and Enter to give up)").and_then(|()| self.prompts.flush());
        prompted.map_err(StageError::Terminal)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        let Some(target) = self.target else { return Ok(false) };
        if self.current == Some(target) {
            return Ok(true);
        }
        match self.answers.next().map_err(StageError::Terminal)? {
            Some(answer) if answer.trim().is_empty() => {
                self.current = Some(target);
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
        // The camera may have been moved already.
        if self.current != self.target {
            self.current = None;
        }
        self.target = None;
        Ok(())
    }
}

impl<W: Write> PosedStage for ManualStage<W> {}

/// The way from one position to another, in words.
fn displacement(from: Position, to: Position) -> String {
    let step = |distance: i64, negative: &str, positive: &str| {
        let direction = if distance < 0 { negative } else { positive };
        (distance != 0).then(|| format!("{:.1} mm {direction}", distance.unsigned_abs() as f64 / 1e3))
    };
    let across = step(i64::from(to.x_um) - i64::from(from.x_um), "to the left", "to the right");
    let down = step(i64::from(to.y_um) - i64::from(from.y_um), "up", "down");
    across.into_iter().chain(down).collect::<Vec<_>>().join(" and ")
}

/// Lines that a person types, read by a thread.
#[derive(Clone)]
struct Answers {
    lines: Arc<Mutex<Receiver<io::Result<String>>>>,
    /// True if a person types the lines. Then a line typed before a prompt is not an answer to it; from a
    /// pipe or file it is.
    is_typed: bool,
}

impl Answers {
    fn read_from(source: impl Read + Send + 'static, is_typed: bool) -> Answers {
        let (sender, lines) = mpsc::channel();
        thread::spawn(move || BufReader::new(source).lines().try_for_each(|line| sender.send(line)));
        Answers { lines: Arc::new(Mutex::new(lines)), is_typed }
    }

    /// Discards lines that were typed before the prompt.
    fn discard_typed(&self) {
        while self.is_typed && matches!(self.next(), Ok(Some(_))) {}
    }

    /// The next line. `None` if there is none yet.
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

    /// A person whose answers a test sends.
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

    fn wait_for_arrival(stage: &mut impl Stage<Error = StageError>) -> Result<(), StageError> {
        let start = Instant::now();
        while !stage.has_arrived()? {
            assert!(start.elapsed() < Duration::from_secs(60), "no answer arrived");
            thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    #[test]
    fn each_move_prompts_the_person() {
        let (person, answers) = mpsc::channel();
        let mut prompts = Vec::new();
        let mut stage = ManualStage::new(Person(answers), &mut prompts, &Limits::default()).unwrap();
        for position in [at(0, 0), at(-20_000, 0), at(0, 1500), at(0, 1500)] {
            stage.move_to(position).unwrap();
            if stage.current != stage.target {
                assert!(!stage.has_arrived().unwrap(), "arrived without an answer");
                person.send("not yet\n").unwrap();
                assert!(!stage.has_arrived().unwrap(), "arrived at something else than an empty line");
                person.send("\n").unwrap();
            }
            wait_for_arrival(&mut stage).unwrap();
            assert_eq!(stage.position().unwrap(), None);
        }
        // After a move that was stopped, the position is unknown.
        stage.move_to(at(5000, 0)).unwrap();
        stage.stop().unwrap();
        assert!(!stage.has_arrived().unwrap());
        stage.move_to(at(0, -5000)).unwrap();
        drop(person);
        assert!(matches!(wait_for_arrival(&mut stage), Err(StageError::Terminal(_))));
        let prompts = String::from_utf8(prompts).unwrap();
        let expected = [
            "Put the camera where the centre image is taken",
            "Move the camera 20.0 mm to the left",
            "Move the camera 20.0 mm to the right and 1.5 mm down",
            "Move the camera 5.0 mm to the right and 1.5 mm up",
            "Put the camera 5.0 mm up from where the centre image is taken",
        ];
        let expected: Vec<_> =
            expected.iter().map(|instruction| format!("{instruction} and press Enter (q and Enter to give up)")).collect();
        assert_eq!(prompts.lines().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn answers_can_come_from_a_pipe() {
        let mut stage = ManualStage::new(&b"\r\n\nq\n"[..], io::sink(), &Limits::default()).unwrap();
        for x_um in [0, 1000] {
            stage.move_to(at(x_um, 0)).unwrap();
            wait_for_arrival(&mut stage).unwrap();
        }
        stage.move_to(at(0, 0)).unwrap();
        assert!(matches!(wait_for_arrival(&mut stage), Err(StageError::GivenUp)));
        assert!(matches!(stage.move_to(at(0, 100_001)), Err(StageError::OutOfReach { .. })));
    }
}
