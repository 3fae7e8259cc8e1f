//! The launcher's end: one thread that owns socket and clients, and two queues to the main loop.
//!
//! The thread knows nothing of the flight. What a client does to it, silence, garbage, a flood,
//! costs that client its conversation and the flight nothing.

use super::SOCKET;
use super::conversation::Conversation;
pub use super::conversation::Limits;
use super::protocol::{Reason, Reply, Request};
use runtime::clock::mono_now_ns;
use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::io;
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};

/// How long no new client is let in after the system had no room for one \[ns\].
const DEAF_NS: u64 = 100_000_000;

/// A request with its way back.
#[derive(Debug)]
pub struct Asked {
    /// What.
    pub request: Request,
    /// Where the answer goes.
    pub answer: Answer,
}

/// The way back to one client. Replies after the last one, or to a client that has gone, are lost.
#[derive(Debug, Clone)]
pub struct Answer {
    client: u64,
    post: Post,
}

impl Answer {
    /// Sends a reply without waiting.
    pub fn send(&self, reply: Reply) {
        self.post.send(Letter::Reply(self.client, Box::new(reply)));
    }
}

impl Answer {
    /// An answer for the calling process itself, with what gives all that has been sent to it since the last time.
    ///
    /// # Errors
    /// If the system has no descriptor left.
    pub fn with_receiver() -> io::Result<(Self, impl FnMut() -> Vec<Reply>)> {
        let (letters, inbox) = channel();
        let bell = eventfd(0, EventfdFlags::NONBLOCK)?;
        let received = move || {
            let letters = inbox.try_iter().filter_map(|letter| match letter {
                Letter::Reply(_, reply) => Some(*reply),
                Letter::Leave => None,
            });
            letters.collect()
        };
        Ok((Self { client: 0, post: Post { letters, bell: Arc::new(bell) } }, received))
    }
}

/// What the main loop sends the thread.
#[derive(Debug)]
enum Letter {
    Reply(u64, Box<Reply>),
    Leave,
}

#[derive(Debug, Clone)]
struct Post {
    letters: Sender<Letter>,
    bell: Arc<OwnedFd>,
}

impl Post {
    fn send(&self, letter: Letter) {
        // Both fail only if the thread has gone, and then no client waits.
        let _ = self.letters.send(letter);
        let _ = rustix::io::write(&*self.bell, &1_u64.to_ne_bytes());
    }
}

/// The control plane of one run. Dropping it closes every conversation and removes the socket.
#[derive(Debug)]
pub struct ControlServer {
    asked: Receiver<Asked>,
    post: Post,
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
}

impl ControlServer {
    /// Opens the socket in a run's folder, for its user alone.
    ///
    /// # Errors
    /// The socket or the thread cannot be made.
    pub fn open(folder: &Path, limits: Limits) -> io::Result<Self> {
        let path = folder.join(SOCKET);
        let listener = UnixListener::bind(&path)?;
        // The modes of folder and socket are the access check. Between bind and chmod only the folder's protects it.
        fs::set_permissions(&path, Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        let bell = Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let (ask, asked) = channel();
        let (letters, inbox) = channel();
        let post = Post { letters, bell };
        let acceptor = Acceptor {
            listener,
            limits,
            inbox,
            ask,
            post: post.clone(),
            clients: BTreeMap::new(),
            next_client: 0,
            deaf_until_ns: 0,
        };
        let thread = Builder::new().name("control".to_owned()).spawn(move || acceptor.serve())?;
        Ok(Self { asked, post, thread: Some(thread), path })
    }

    /// The next request, if there is one; never waits.
    #[must_use]
    pub fn take(&self) -> Option<Asked> {
        self.asked.try_recv().ok()
    }
}

impl Drop for ControlServer {
    fn drop(&mut self) {
        self.post.send(Letter::Leave);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = fs::remove_file(&self.path);
    }
}

/// What the thread has.
struct Acceptor {
    listener: UnixListener,
    limits: Limits,
    inbox: Receiver<Letter>,
    ask: Sender<Asked>,
    post: Post,
    clients: BTreeMap<u64, Conversation>,
    next_client: u64,
    deaf_until_ns: u64,
}

impl Acceptor {
    fn serve(mut self) {
        while let Ok((newcomers, happened)) = self.wait() {
            if !self.deliver() {
                return;
            }
            let now_ns = mono_now_ns();
            for (client, happened) in happened {
                let Some(conversation) = self.clients.get_mut(&client) else { continue };
                if let Some(request) = conversation.go_on(happened, now_ns) {
                    let answer = Answer { client, post: self.post.clone() };
                    // Fails only at the very end, when Leave is on its way.
                    let _ = self.ask.send(Asked { request, answer });
                }
            }
            self.clients.retain(|_, conversation| !conversation.is_over());
            if newcomers {
                self.let_in();
            }
        }
    }

    /// Waits until something happens: whether a client is at the door, and what to each client.
    fn wait(&self) -> io::Result<(bool, Vec<(u64, PollFlags)>)> {
        let now_ns = mono_now_ns();
        let deaf = now_ns < self.deaf_until_ns;
        let door = if deaf { PollFlags::empty() } else { PollFlags::IN };
        let mut fds = vec![
            PollFd::new(&*self.post.bell, PollFlags::IN),
            PollFd::from_borrowed_fd(self.listener.as_fd(), door),
        ];
        fds.extend(self.clients.values().map(|c| PollFd::new(c, c.interest())));
        let deadlines = self.clients.values().map(Conversation::deadline_ns);
        let until_ns = deadlines.chain(deaf.then_some(self.deaf_until_ns)).min();
        let limit = until_ns.filter(|until| *until < u64::MAX).map(|until| {
            let left = core::time::Duration::from_nanos(until.saturating_sub(now_ns));
            Timespec::try_from(left).unwrap_or_default()
        });
        match poll(&mut fds, limit.as_ref()) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        let newcomers = fds[1].revents().contains(PollFlags::IN);
        let happened = self.clients.keys().copied().zip(fds[2..].iter().map(PollFd::revents));
        Ok((newcomers, happened.collect()))
    }

    /// Hands out what the main loop sends; false once it orders to leave.
    fn deliver(&mut self) -> bool {
        // Read before the letters, so that none is left without a ring.
        let _ = rustix::io::read(&*self.post.bell, &mut [0; 8]);
        while let Ok(letter) = self.inbox.try_recv() {
            let Letter::Reply(client, reply) = letter else { return false };
            if let Some(conversation) = self.clients.get_mut(&client) {
                conversation.reply(&reply, mono_now_ns());
            }
        }
        true
    }

    /// Lets one in: before the next one, clients that have left by then make room.
    fn let_in(&mut self) {
        use io::ErrorKind::{Interrupted, WouldBlock};
        let now_ns = mono_now_ns();
        match self.listener.accept() {
            Ok((stream, _)) => self.greet(stream, now_ns),
            Err(error) if matches!(error.kind(), Interrupted | WouldBlock) => {}
            Err(_) => self.deaf_until_ns = now_ns + DEAF_NS,
        }
    }

    fn greet(&mut self, stream: UnixStream, now_ns: u64) {
        if stream.set_nonblocking(true).is_err() {
            return;
        }
        let mut conversation = Conversation::new(stream, self.limits, now_ns);
        if self.clients.len() >= self.limits.clients {
            self.make_room(now_ns);
        }
        if self.clients.len() >= self.limits.clients {
            let text = format!("{} others are asking: try again", self.clients.len());
            conversation.refuse(Reason::TooMany, text, now_ns);
        }
        // A client that is not welcome has been refused, as far as one write goes.
        if !conversation.is_over() {
            self.clients.insert(self.next_client, conversation);
            self.next_client += 1;
        }
    }

    /// Ends the conversation that has kept its place for nothing for longest, if one has for long enough.
    fn make_room(&mut self, now_ns: u64) {
        let idle = |(client, conversation): (&u64, &Conversation)| {
            let idle_ns = conversation.idle_ns(now_ns)?;
            (idle_ns >= self.limits.idle_ns).then_some((idle_ns, *client))
        };
        let longest = self.clients.iter().filter_map(idle).max();
        let silent = longest.and_then(|(_, client)| self.clients.remove(&client));
        if let Some(mut conversation) = silent {
            let text = "others are waiting for a place, and nothing was asked for";
            conversation.refuse(Reason::TooMany, text, now_ns);
        }
    }
}
