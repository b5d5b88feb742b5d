//! A network without sockets, in simulated time.

use std::{
    collections::VecDeque,
    io::{self, ErrorKind, Read, Write},
    ops::ControlFlow,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use multiscopic::capture::{
    Clock,
    stage::robot_arm::{Connection, Network},
};

use super::{Device, SimulatedClock};

/// The interval at which a read that waits looks again.
const LOOK: Duration = Duration::from_millis(1);

/// The system time that a thread may take to read what has arrived. Only a hung test reaches it.
const PATIENCE: Duration = Duration::from_secs(120);

/// A server's part in one connection.
pub trait Service: Send {
    /// Takes the bytes that have arrived, perhaps none, and adds what it sends to `answer`. With a break, it hangs up after
    /// that.
    fn serve(&mut self, arrived: &[u8], now: Instant, answer: &mut Vec<u8>) -> ControlFlow<()>;

    /// The time at which it has something to send unasked.
    fn due(&self) -> Option<Instant> {
        None
    }
}

/// Answers connections to a port.
type Answer = dyn Fn(u16) -> Option<Box<dyn Service>> + Send + Sync;

/// A network with one server.
pub struct SimulatedNetwork {
    clock: Arc<SimulatedClock>,
    answer: Box<Answer>,
    links: Mutex<Vec<Arc<Link>>>,
}

impl SimulatedNetwork {
    /// A network whose server has a service for each connection, or refuses it.
    pub fn new(
        clock: &Arc<SimulatedClock>,
        answer: impl Fn(u16) -> Option<Box<dyn Service>> + Send + Sync + 'static,
    ) -> Arc<SimulatedNetwork> {
        let network = Arc::new(SimulatedNetwork { clock: clock.clone(), answer: Box::new(answer), links: Mutex::default() });
        let device: Arc<dyn Device> = network.clone();
        clock.attach(Arc::downgrade(&device));
        network
    }

    /// The client's end of the network.
    pub fn client(self: &Arc<SimulatedNetwork>) -> Box<dyn Network> {
        Box::new(Client(self.clone()))
    }

    /// Ends all connections, and waits until the client's threads know.
    pub fn disconnect(&self) {
        for link in self.links() {
            link.end();
            link.settle();
        }
    }

    fn links(&self) -> Vec<Arc<Link>> {
        let mut links = self.links.lock().unwrap_or_else(PoisonError::into_inner);
        links.retain(|link| {
            let state = link.lock();
            !state.has_ended || state.readers > 0
        });
        links.clone()
    }
}

impl Device for SimulatedNetwork {
    fn step(&self) {
        for link in self.links() {
            link.serve(&[]);
            link.settle();
        }
    }
}

struct Client(Arc<SimulatedNetwork>);

impl Network for Client {
    fn connect(&self, port: u16, _: Duration) -> io::Result<Box<dyn Connection>> {
        let service = (self.0.answer)(port).ok_or(ErrorKind::ConnectionRefused)?;
        let state = LinkState {
            service,
            answer: VecDeque::new(),
            has_ended: false,
            read_timeout: None,
            is_waiting: false,
            handles: 1,
            readers: 0,
        };
        let link = Arc::new(Link { clock: self.0.clock.clone(), state: Mutex::new(state), changed: Condvar::new() });
        self.0.links.lock().unwrap_or_else(PoisonError::into_inner).push(link.clone());
        Ok(Box::new(Handle { link, is_reader: false }))
    }
}

/// One connection.
struct Link {
    clock: Arc<SimulatedClock>,
    state: Mutex<LinkState>,
    changed: Condvar,
}

struct LinkState {
    service: Box<dyn Service>,
    /// Sent by the server and not yet read.
    answer: VecDeque<u8>,
    has_ended: bool,
    read_timeout: Option<Duration>,
    /// True while a thread waits for bytes without limit.
    is_waiting: bool,
    handles: usize,
    /// Handles that were cloned: each is for a thread that reads.
    readers: usize,
}

impl Link {
    fn lock(&self) -> MutexGuard<'_, LinkState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands bytes to the server, and takes what it sends.
    fn serve(&self, arrived: &[u8]) {
        let mut state = self.lock();
        if !state.has_ended {
            let mut answer = Vec::new();
            let flow = state.service.serve(arrived, self.clock.now(), &mut answer);
            state.answer.extend(answer);
            state.has_ended = flow.is_break();
            self.changed.notify_all();
        }
    }

    fn end(&self) {
        self.lock().has_ended = true;
        self.changed.notify_all();
    }

    /// Waits until a thread that reads has taken everything and waits for more, or has ended with the connection.
    fn settle(&self) {
        let is_busy = |state: &mut LinkState| {
            let has_all = state.is_waiting && state.answer.is_empty() && !state.has_ended;
            state.read_timeout.is_none() && state.readers > 0 && !has_all
        };
        let waited = self.changed.wait_timeout_while(self.lock(), PATIENCE, is_busy);
        let is_hung = waited.unwrap_or_else(PoisonError::into_inner).1.timed_out();
        assert!(!is_hung, "nobody reads what the server sent");
    }
}

/// A client's handle of a connection.
struct Handle {
    link: Arc<Link>,
    is_reader: bool,
}

impl Read for Handle {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let link = &self.link;
        let deadline = link.lock().read_timeout.map(|limit| link.clock.now() + limit);
        loop {
            let mut state = link.lock();
            if !state.answer.is_empty() {
                state.is_waiting = false;
                let count = state.answer.len().min(buffer.len());
                buffer.iter_mut().zip(state.answer.drain(..count)).for_each(|(to, from)| *to = from);
                return Ok(count);
            }
            if state.has_ended {
                return Ok(0);
            }
            match deadline {
                None => {
                    state.is_waiting = true;
                    link.changed.notify_all();
                    drop(link.changed.wait(state).unwrap_or_else(PoisonError::into_inner));
                }
                Some(deadline) if link.clock.now() >= deadline => return Err(ErrorKind::TimedOut.into()),
                Some(_) => {
                    drop(state);
                    link.clock.sleep(LOOK);
                }
            }
        }
    }
}

impl Write for Handle {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.link.lock().has_ended {
            return Err(ErrorKind::BrokenPipe.into());
        }
        self.link.serve(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Connection for Handle {
    fn try_clone(&self) -> io::Result<Box<dyn Connection>> {
        let mut state = self.link.lock();
        state.handles += 1;
        state.readers += 1;
        Ok(Box::new(Handle { link: self.link.clone(), is_reader: true }))
    }

    fn set_read_timeout(&self, limit: Option<Duration>) -> io::Result<()> {
        self.link.lock().read_timeout = limit;
        Ok(())
    }

    fn set_write_timeout(&self, _: Duration) -> io::Result<()> {
        Ok(())
    }

    fn shutdown(&self) {
        self.link.end();
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        let mut state = self.link.lock();
        state.handles -= 1;
        state.readers -= usize::from(self.is_reader);
        state.has_ended |= state.handles == 0;
        self.link.changed.notify_all();
    }
}
