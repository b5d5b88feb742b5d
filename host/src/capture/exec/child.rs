//! A child process, and its pipes as a stream whose reads time out.

use std::{
    io::{self, Read, Write},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    sync::mpsc::{self, Receiver, RecvTimeoutError},
    thread,
    time::{Duration, Instant},
};

use super::error::{ExecError, ExecFault};

/// The time for which a read blocks.
const READ_TIMEOUT: Duration = Duration::from_millis(10);

/// The time that a command has to end by itself once its input has.
const GRACE: Duration = Duration::from_secs(2);

/// The interval at which the end of a command is looked for.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// Pieces of its output that wait to be read. A command that says more is held up.
const MOST_PIECES: usize = 16;

/// A running command, and its standard input and output. Dropping it closes the input, and ends the command and all that it
/// started if it does not end soon.
pub(in crate::capture) struct ChildPort {
    child: Child,
    input: Option<ChildStdin>,
    /// Pieces of its output, until it ends.
    output: Receiver<Vec<u8>>,
    /// The part of a piece that has not been read.
    rest: Vec<u8>,
}

impl ChildPort {
    /// Starts a command, which is split into words as a shell would.
    pub fn start(command: &str) -> Result<ChildPort, ExecError> {
        let failed = |source| ExecError { command: command.into(), fault: ExecFault::NotStarted(source) };
        let words = super::words(command).map_err(|problem| failed(io::Error::new(io::ErrorKind::InvalidInput, problem)))?;
        let mut child = Command::new(&words[0]);
        child.args(&words[1..]).stdin(Stdio::piped()).stdout(Stdio::piped());
        // A group of its own: Ctrl-C at the terminal is for this program, which then tells the command to stop.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut child, 0);
        let mut child = child.spawn().map_err(failed)?;
        let (input, output) = (child.stdin.take(), child.stdout.take().map(read_in_thread));
        let output = output.expect("its output is a pipe");
        Ok(ChildPort { child, input, output, rest: Vec::new() })
    }

    /// Returns true once it has ended, which it has `limit` for.
    fn has_ended(&mut self, limit: Duration) -> bool {
        let deadline = Instant::now() + limit;
        loop {
            match self.child.try_wait() {
                Ok(None) if Instant::now() < deadline => thread::sleep(POLL_INTERVAL),
                Ok(None) => return false,
                _ => return true,
            }
        }
    }

    /// Ends it and all processes of its group.
    fn kill(&mut self) {
        #[cfg(unix)]
        let _ = rustix::process::kill_process_group(rustix::process::Pid::from_child(&self.child), rustix::process::Signal::KILL);
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The pieces that come out of a pipe. The thread ends with the pipe, or with the receiver.
fn read_in_thread(mut pipe: ChildStdout) -> Receiver<Vec<u8>> {
    let (sender, receiver) = mpsc::sync_channel(MOST_PIECES);
    thread::spawn(move || {
        let mut piece = [0; 1024];
        loop {
            match pipe.read(&mut piece) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Ok(count) if count > 0 && sender.send(piece[..count].to_vec()).is_ok() => {}
                _ => break,
            }
        }
    });
    receiver
}

impl Read for ChildPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.rest.is_empty() {
            self.rest = match self.output.recv_timeout(READ_TIMEOUT) {
                Ok(piece) => piece,
                Err(RecvTimeoutError::Timeout) => return Err(io::ErrorKind::TimedOut.into()),
                Err(RecvTimeoutError::Disconnected) => {
                    let status = if self.has_ended(READ_TIMEOUT) { self.child.try_wait().ok().flatten() } else { None };
                    let reason = status.map_or("it closed its output".into(), |status| status.to_string());
                    return Err(io::Error::new(io::ErrorKind::UnexpectedEof, reason));
                }
            };
        }
        let count = self.rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&self.rest[..count]);
        self.rest.drain(..count);
        Ok(count)
    }
}

impl Write for ChildPort {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.input.as_mut().map_or(Err(io::ErrorKind::BrokenPipe.into()), |input| input.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for ChildPort {
    fn drop(&mut self) {
        self.input = None;
        if !self.has_ended(GRACE) {
            self.kill();
        }
    }
}
