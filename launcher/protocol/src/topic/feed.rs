//! The launcher's end: copies of the samples that a client wants to see.
//!
//! The main loop packs a sample only if a client wants its topic, and puts it into a queue without ever
//! waiting; the thread does the rest. A sample that finds the queue or a client's buffer full is dropped and counted;
//! for events, which are few and come once, there is room beyond.

use super::{SOCKET, known, place, schema};
use record::{Clock, Event, encode_log};
use runtime::clock::mono_now_ns;
use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use serde::{Deserialize, Serialize};
use shared_types::{Sample, Topic};
use std::fs::{self, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

/// Samples between the main loop and the thread.
const QUEUE: usize = 16_384;
/// Events between the same.
const EVENT_QUEUE: usize = 1024;
/// Samples that one client has not read yet \[bytes\].
const UNREAD_BYTES: usize = 4 << 20;
/// Events that it has not read yet \[bytes\].
const EVENT_BYTES: usize = 1 << 20;
/// Longest request \[bytes\].
const REQUEST_BYTES: usize = 16 << 10;
/// Listeners at a time.
const CLIENTS: usize = 8;
/// How long clients may take at the end to read what is still on its way to them \[ns\]: one that stands back for the
/// processes of a flight, on a busy machine, takes its time for the 4 MB that it may be behind.
const FLUSH_LIMIT_NS: u64 = 30_000_000_000;
/// How long a client may take to ask, and to read anything at all once its buffer is full, or at the end \[ns\].
const PATIENCE_NS: u64 = 5_000_000_000;
/// How long no new client is let in after the system had no room for one \[ns\].
const DEAF_NS: u64 = 100_000_000;
/// How often the queue is looked at while a client listens \[ns\].
const LOOK_EVERY_NS: i64 = 10_000_000;
/// In place of a topic: so many samples have been dropped.
pub(super) const DROPPED: u16 = u16::MAX;
/// In place of a topic: an event, as a recording has it.
pub(super) const LOG: u16 = u16::MAX - 1;
/// In place of a topic: the flight is over, and how.
pub(super) const ENDED: u16 = u16::MAX - 2;
/// Among the topics that a client wants: events.
const EVENTS: u64 = 1 << 63;

/// What a client asks for, as a line of JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Listen {
    /// Topics, each with the layout that the client knows, in hexadecimal.
    pub(super) listen: Vec<(String, String)>,
    /// Whether to be sent events, and the end.
    #[serde(default)]
    pub(super) events: bool,
}

/// The answer: which flight it is, or why not.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Answer {
    pub(super) error: Option<String>,
    pub(super) flight: Option<Flying>,
}

/// How a flight's logical time stands to the clock on the wall.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Flying {
    /// Unix time that stands for logical time 0 \[ns\].
    pub epoch_unix_ns: u64,
    /// In realtime, logical seconds per wall second.
    pub speed: Option<f64>,
}

impl Flying {
    /// Of a flight.
    #[must_use]
    pub fn new(epoch_unix_ns: u64, clock: Clock) -> Self {
        let speed = match clock {
            Clock::Lockstep => None,
            Clock::Realtime { speed } => Some(speed),
        };
        Self { epoch_unix_ns, speed }
    }

    /// How time stamps run.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.speed.map_or(Clock::Lockstep, |speed| Clock::Realtime { speed })
    }

    /// Unix time that stands for a logical instant \[ns\].
    #[must_use]
    pub fn unix_ns(&self, logical_ns: u64) -> u64 {
        self.clock().unix_ns(self.epoch_unix_ns, logical_ns)
    }
}

/// How a flight has ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ending {
    /// As planned, and no gate failed.
    pub is_good: bool,
    /// In short.
    pub text: String,
}

/// A packed sample.
struct Frame {
    topic: u16,
    packed: Vec<u8>,
}

/// What main loop and thread share.
#[derive(Debug, Default)]
struct Shared {
    /// A bit for each topic that a client wants.
    wanted: AtomicU64,
    /// Samples in the queue.
    queued: AtomicUsize,
    /// What found the queue full.
    dropped: AtomicU64,
    leave: AtomicBool,
}

/// Lets others listen to a run. Dropping it ends every conversation and removes the socket.
#[derive(Debug)]
pub struct Feed {
    shared: Arc<Shared>,
    frames: SyncSender<Frame>,
    bell: Arc<OwnedFd>,
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
    flying: Flying,
}

impl Feed {
    /// Opens the socket in a run's folder, for its user alone.
    ///
    /// # Errors
    /// The socket or the thread cannot be made.
    pub fn open(folder: &Path, flying: Flying) -> io::Result<Self> {
        let path = folder.join(SOCKET);
        // A launcher that has died leaves its own.
        let _ = fs::remove_file(&path);
        let listener = UnixListener::bind(&path)?;
        fs::set_permissions(&path, Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        let bell = Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let (frames, queue) = sync_channel(QUEUE + EVENT_QUEUE);
        let shared = Arc::<Shared>::default();
        let acceptor = Acceptor {
            listener,
            bell: Arc::clone(&bell),
            queue,
            shared: Arc::clone(&shared),
            counted_dropped: 0,
            clients: Vec::new(),
            flying,
            deaf_until_ns: 0,
        };
        let thread = Builder::new().name("topics".to_owned()).spawn(move || acceptor.serve())?;
        Ok(Self { shared, frames, bell, thread: Some(thread), path, flying })
    }

    /// Takes a copy if a client wants it. Never waits.
    pub fn offer<T: Sample>(&self, topic: &'static Topic<T>, sample: &T) {
        let wanted = self.shared.wanted.load(Ordering::Acquire);
        if wanted == 0 {
            return;
        }
        let place = place(&topic.info);
        if wanted & (1 << place) == 0 {
            return;
        }
        if self.shared.queued.load(Ordering::Acquire) >= QUEUE {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let mut packed = vec![0; T::PACKED_SIZE];
        sample.pack(&mut packed);
        // Before it is there for the thread, which counts it out.
        self.shared.queued.fetch_add(1, Ordering::AcqRel);
        if !self.put(u16::try_from(place).unwrap_or(DROPPED), packed) {
            self.shared.queued.fetch_sub(1, Ordering::AcqRel);
        }
    }

    /// Publishes an event to each client that wants events. Never waits.
    pub fn publish(&self, event: &Event<'_>) {
        if self.shared.wanted.load(Ordering::Acquire) & EVENTS != 0 {
            let mut log = Vec::new();
            encode_log(event, self.flying.unix_ns(event.logical_ns), &mut log);
            self.put(LOG, log);
        }
    }

    /// Publishes how the flight has ended; nothing comes after it. Waits for a place in the queue, which the
    /// thread empties all the time: without this message a listener would wait for another launcher.
    pub fn end(&self, ending: &Ending) {
        // It holds a string and a flag, which JSON can hold.
        let packed = serde_json::to_vec(ending).unwrap_or_default();
        let _ = self.frames.send(Frame { topic: ENDED, packed });
    }

    /// False if there is no place for it in the queue.
    fn put(&self, topic: u16, packed: Vec<u8>) -> bool {
        let is_there = self.frames.try_send(Frame { topic, packed }).is_ok();
        self.shared.dropped.fetch_add(u64::from(!is_there), Ordering::Relaxed);
        is_there
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.shared.leave.store(true, Ordering::Release);
        let _ = rustix::io::write(&*self.bell, &1_u64.to_ne_bytes());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = fs::remove_file(&self.path);
    }
}

/// One listener.
struct Client {
    stream: UnixStream,
    /// When it came, or last read something \[ns\].
    moved_ns: u64,
    /// Until the request is complete.
    inbox: Vec<u8>,
    wanted: u64,
    outbox: Vec<u8>,
    dropped: u64,
    over: bool,
}

/// What the thread has.
struct Acceptor {
    listener: UnixListener,
    bell: Arc<OwnedFd>,
    queue: Receiver<Frame>,
    shared: Arc<Shared>,
    counted_dropped: u64,
    clients: Vec<Client>,
    flying: Flying,
    /// Until when no client is let in, after the system had no room for one \[ns\].
    deaf_until_ns: u64,
}

impl Acceptor {
    fn serve(mut self) {
        while self.wait().is_ok() {
            let leaves = self.shared.leave.load(Ordering::Acquire);
            self.hand_out();
            for client in &mut self.clients {
                client.read(self.flying);
            }
            // Before the answers: a client that has one gets every sample from then on.
            self.store_wanted();
            for client in &mut self.clients {
                client.write();
            }
            self.clients.retain(|client| !client.over);
            self.store_wanted();
            if leaves {
                self.flush();
                return;
            }
            self.let_in();
        }
    }

    /// Waits until every client has read what is on its way to it, but for none that has stopped reading.
    fn flush(&mut self) {
        let begun_ns = mono_now_ns();
        let give_up_ns = begun_ns + FLUSH_LIMIT_NS;
        loop {
            let now_ns = mono_now_ns();
            self.clients.retain(|client| {
                let reads = now_ns.saturating_sub(client.moved_ns.max(begun_ns)) < PATIENCE_NS;
                reads && !client.over && !client.outbox.is_empty()
            });
            let left_ns = give_up_ns.saturating_sub(now_ns);
            if self.clients.is_empty() || left_ns == 0 {
                return;
            }
            let mut fds: Vec<_> = self
                .clients
                .iter()
                .map(|client| PollFd::new(&client.stream, PollFlags::OUT))
                .collect();
            let limit = Timespec {
                tv_sec: 0,
                tv_nsec: LOOK_EVERY_NS.min(i64::try_from(left_ns).unwrap_or(LOOK_EVERY_NS)),
            };
            let _ = poll(&mut fds, Some(&limit));
            for client in &mut self.clients {
                client.write();
            }
        }
    }

    fn store_wanted(&self) {
        let wanted = self.clients.iter().fold(0, |all, client| all | client.wanted);
        self.shared.wanted.store(wanted, Ordering::Release);
    }

    /// Waits for a client at the door, or, while any listens, a moment.
    fn wait(&self) -> io::Result<()> {
        let mut fds =
            [PollFd::new(&*self.bell, PollFlags::IN), PollFd::new(&self.listener, PollFlags::IN)];
        let is_deaf = self.is_deaf();
        let fds = if is_deaf { &mut fds[..1] } else { &mut fds[..] };
        let moment = Timespec { tv_sec: 0, tv_nsec: LOOK_EVERY_NS };
        let limit = (is_deaf || !self.clients.is_empty()).then_some(&moment);
        match poll(fds, limit) {
            Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    fn is_deaf(&self) -> bool {
        mono_now_ns() < self.deaf_until_ns
    }

    fn let_in(&mut self) {
        while !self.is_deaf() {
            let stream = match self.listener.accept() {
                Ok((stream, _)) => stream,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return,
                Err(_) => {
                    // It would be heard at once again, and as often as a processor can.
                    self.deaf_until_ns = mono_now_ns() + DEAF_NS;
                    return;
                }
            };
            if stream.set_nonblocking(true).is_err() {
                continue;
            }
            let mut client = Client {
                stream,
                moved_ns: mono_now_ns(),
                inbox: Vec::new(),
                wanted: 0,
                outbox: Vec::new(),
                dropped: 0,
                over: false,
            };
            if self.clients.len() >= CLIENTS {
                self.make_room();
            }
            if self.clients.len() < CLIENTS {
                self.clients.push(client);
            } else {
                client.refuse(format!("{CLIENTS} others are listening: try again"));
            }
        }
    }

    /// Takes the place of the client that has kept it for nothing for longest, if one has lost all patience:
    /// it has asked for nothing yet, or reads nothing of a full buffer.
    fn make_room(&mut self) {
        let now_ns = mono_now_ns();
        let idle = |client: &Client| {
            let is_idle = client.wanted == 0 || client.outbox.len() > UNREAD_BYTES / 2;
            is_idle && now_ns.saturating_sub(client.moved_ns) >= PATIENCE_NS
        };
        let longest = self.clients.iter().enumerate().filter(|(_, client)| idle(client));
        if let Some((index, _)) = longest.min_by_key(|(_, client)| client.moved_ns) {
            self.clients.remove(index);
        }
    }

    /// Gives each client what it wants of what has come.
    fn hand_out(&mut self) {
        while let Ok(Frame { topic, packed }) = self.queue.try_recv() {
            let is_sample = topic < ENDED;
            self.shared.queued.fetch_sub(usize::from(is_sample), Ordering::AcqRel);
            let bit = if is_sample { 1 << topic } else { EVENTS };
            for client in self.clients.iter_mut().filter(|client| client.wanted & bit != 0) {
                client.put(topic, &packed);
            }
        }
        let dropped = self.shared.dropped.load(Ordering::Relaxed);
        let lost = dropped - core::mem::replace(&mut self.counted_dropped, dropped);
        for client in self.clients.iter_mut().filter(|client| client.wanted != 0) {
            client.dropped += lost;
        }
    }
}

impl Client {
    fn put(&mut self, topic: u16, packed: &[u8]) {
        let room = if topic == LOG { UNREAD_BYTES + EVENT_BYTES } else { UNREAD_BYTES };
        let has_room = self.outbox.len() + packed.len() <= room;
        if !has_room && topic != ENDED {
            self.dropped += 1;
            return;
        }
        self.outbox.extend(topic.to_le_bytes());
        self.outbox.extend(u32::try_from(packed.len()).unwrap_or(0).to_le_bytes());
        self.outbox.extend(packed);
    }

    /// Reads the request; whatever comes after it, or an end, ends the conversation.
    fn read(&mut self, flying: Flying) {
        let mut chunk = [0; 4096];
        while !self.over {
            match self.stream.read(&mut chunk) {
                Ok(0) => self.over = true,
                Ok(count) if self.wanted == 0 => {
                    self.inbox.extend_from_slice(&chunk[..count]);
                    self.answer(flying);
                    continue;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Ok(_) | Err(_) => self.over = true,
            }
            return;
        }
    }

    fn answer(&mut self, flying: Flying) {
        let Some(end) = self.inbox.iter().position(|byte| *byte == b'\n') else {
            if self.inbox.len() > REQUEST_BYTES {
                self.refuse(format!("a request has at most {REQUEST_BYTES} bytes"));
            }
            return;
        };
        let line: Vec<u8> = self.inbox.drain(..=end).collect();
        let asked = serde_json::from_slice::<Listen>(&line);
        match asked.map_err(|error| format!("not a request: {error}")).and_then(|l| wanted(&l)) {
            Ok(wanted) => {
                self.wanted = wanted;
                self.reply(&Answer { error: None, flight: Some(flying) });
            }
            Err(error) => self.refuse(error),
        }
    }

    fn reply(&mut self, answer: &Answer) {
        // It holds a string, which JSON can hold.
        let _ = serde_json::to_writer(&mut self.outbox, answer);
        self.outbox.push(b'\n');
    }

    fn refuse(&mut self, error: String) {
        self.reply(&Answer { error: Some(error), flight: None });
        self.write();
        self.over = true;
    }

    /// Writes what the client takes.
    fn write(&mut self) {
        if self.dropped > 0 && self.outbox.len() < UNREAD_BYTES / 2 {
            let dropped = core::mem::take(&mut self.dropped);
            self.put(DROPPED, &dropped.to_le_bytes());
        }
        let mut written = 0;
        while written < self.outbox.len() {
            match self.stream.write(&self.outbox[written..]) {
                Ok(count) => {
                    written += count;
                    self.moved_ns = mono_now_ns();
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(_) => {
                    self.over = true;
                    return;
                }
            }
        }
        self.outbox.drain(..written);
    }
}

/// A bit for each topic, if all are known and laid out as here.
fn wanted(listen: &Listen) -> Result<u64, String> {
    let mut wanted = if listen.events { EVENTS } else { 0 };
    for (name, theirs) in &listen.listen {
        let topic = known(name).ok_or_else(|| format!("this run has no topic {name}"))?;
        let ours = schema(topic).map_or(0, |schema| schema.layout_hash);
        if *theirs != format!("{ours:016x}") {
            return Err(format!(
                "{name} is laid out otherwise by this run ({ours:016x}) than by the executable that asks ({theirs}): ask with the executable that flies"
            ));
        }
        wanted |= 1 << place(topic);
    }
    if wanted == 0 { Err("no topic is asked for".to_owned()) } else { Ok(wanted) }
}
