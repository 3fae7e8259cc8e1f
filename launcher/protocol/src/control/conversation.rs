//! One client: its line as it comes in, its answers as they go out.
//!
//! ```text
//!              whole line              last reply
//!   Listening ───────────▶ Answering ────────────▶ Listening
//!       │ too long, too slow, no request │ reads nothing, or more than it may
//!       └───────────▶ Closing ◀──────────┘
//! ```

use super::protocol::{Reason, Refusal, Reply, Request};
use rustix::event::PollFlags;
use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;

/// What a client may take.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Longest request \[bytes\].
    pub request_bytes: usize,
    /// Answers that a client has not read yet \[bytes\].
    pub unread_bytes: usize,
    /// For a whole request to come, and for an answer to be read \[ns\].
    pub patience_ns: u64,
    /// Conversations at a time.
    pub clients: usize,
    /// For how long one may keep its place without asking for anything while others are waiting for it \[ns\].
    pub idle_ns: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            request_bytes: 16 * 1024,
            unread_bytes: 256 * 1024,
            patience_ns: 10_000_000_000,
            clients: 16,
            idle_ns: 1_000_000_000,
        }
    }
}

/// What the conversation waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// For a request.
    Listening,
    /// For the launcher's answer; nothing more is read until it is there.
    Answering,
    /// For the last replies to leave.
    Closing,
    /// For nothing.
    Over,
}

/// One client.
#[derive(Debug)]
pub(super) struct Conversation {
    stream: UnixStream,
    limits: Limits,
    state: State,
    inbox: Vec<u8>,
    outbox: Vec<u8>,
    /// The client will send nothing more.
    at_eof: bool,
    /// When patience with this client ends; never while the launcher is the slow one \[ns\].
    deadline_ns: u64,
}

impl Conversation {
    /// With a client that has just been let in; its stream does not block.
    pub(super) fn new(stream: UnixStream, limits: Limits, now_ns: u64) -> Self {
        Self {
            stream,
            limits,
            state: State::Listening,
            inbox: Vec::new(),
            outbox: Vec::new(),
            at_eof: false,
            deadline_ns: now_ns + limits.patience_ns,
        }
    }

    pub(super) fn is_over(&self) -> bool {
        self.state == State::Over
    }

    /// When to look at the conversation even if nothing happens \[ns\].
    pub(super) fn deadline_ns(&self) -> u64 {
        self.deadline_ns
    }

    /// For how long it has kept its place without asking for anything \[ns\]; none if an answer is on its way.
    pub(super) fn idle_ns(&self, now_ns: u64) -> Option<u64> {
        let heard_ns = self.deadline_ns.saturating_sub(self.limits.patience_ns);
        let is_idle = self.state == State::Listening && self.outbox.is_empty();
        is_idle.then(|| now_ns.saturating_sub(heard_ns))
    }

    /// What to wait for.
    pub(super) fn interest(&self) -> PollFlags {
        let mut interest = PollFlags::empty();
        interest.set(PollFlags::IN, self.state == State::Listening && !self.at_eof);
        interest.set(PollFlags::OUT, !self.outbox.is_empty());
        interest
    }

    /// Does what can be done now; a request if one is complete.
    pub(super) fn go_on(&mut self, happened: PollFlags, now_ns: u64) -> Option<Request> {
        if happened.intersects(PollFlags::IN | PollFlags::HUP) && self.state == State::Listening {
            self.read();
        }
        let request = self.next_request(now_ns);
        if now_ns >= self.deadline_ns {
            self.check_timeouts(now_ns);
        }
        self.write(now_ns);
        // No client is left to answer; what was asked for happens all the same.
        if happened.intersects(PollFlags::HUP | PollFlags::ERR) {
            self.state = State::Over;
        }
        request
    }

    /// Queues a reply; after the last one the client may ask again.
    pub(super) fn reply(&mut self, reply: &Reply, now_ns: u64) {
        if matches!(self.state, State::Closing | State::Over) {
            return;
        }
        self.put(reply);
        if reply.is_last() {
            self.state = State::Listening;
        }
        self.deadline_ns = now_ns + self.limits.patience_ns;
        self.write(now_ns);
    }

    /// Sends why this ends, and ends it.
    pub(super) fn refuse(&mut self, reason: Reason, text: impl Into<String>, now_ns: u64) {
        self.put(&Reply::Refused(Refusal::new(reason, text)));
        self.state = State::Closing;
        self.deadline_ns = now_ns + self.limits.patience_ns;
        self.write(now_ns);
    }

    fn put(&mut self, reply: &Reply) {
        let line = serde_json::to_vec(reply).unwrap_or_else(|error| {
            // A line is answered whole, or it is said why not.
            let text = format!("the answer cannot be written down: {error}");
            let refusal = Reply::Refused(Refusal::new(Reason::Failed, text));
            serde_json::to_vec(&refusal).unwrap_or_default()
        });
        self.outbox.extend_from_slice(&line);
        self.outbox.push(b'\n');
        if self.outbox.len() > self.limits.unread_bytes {
            self.state = State::Over;
        }
    }

    /// Reads what is there, up to a little more than a request may be.
    fn read(&mut self) {
        let mut chunk = [0; 4096];
        while self.inbox.len() <= self.limits.request_bytes {
            match self.stream.read(&mut chunk) {
                Ok(0) => self.at_eof = true,
                Ok(count) => {
                    self.inbox.extend_from_slice(&chunk[..count]);
                    continue;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(_) => self.state = State::Over,
            }
            return;
        }
    }

    /// Takes a line out of the inbox, if one is due.
    fn next_request(&mut self, now_ns: u64) -> Option<Request> {
        if self.state != State::Listening {
            return None;
        }
        let end = self.inbox.iter().position(|byte| *byte == b'\n');
        let limit = self.limits.request_bytes;
        if end.unwrap_or(self.inbox.len()) > limit {
            let text = format!("a request has at most {limit} bytes, and this one goes on");
            self.refuse(Reason::BadRequest, text, now_ns);
            return None;
        }
        let Some(end) = end else {
            if self.at_eof {
                self.end_of_input(now_ns);
            }
            return None;
        };
        let line: Vec<u8> = self.inbox.drain(..=end).collect();
        match serde_json::from_slice(&line) {
            Ok(request) => {
                self.state = State::Answering;
                self.deadline_ns = u64::MAX;
                Some(request)
            }
            Err(error) => {
                let text = format!(
                    "not a request: {error}; write one JSON object per line, for example {}",
                    r#"{"request":"ps"}"#
                );
                self.refuse(Reason::BadRequest, text, now_ns);
                None
            }
        }
    }

    fn end_of_input(&mut self, now_ns: u64) {
        if !self.inbox.is_empty() {
            let text = "the request has no end: close it with a line feed";
            self.refuse(Reason::BadRequest, text, now_ns);
        } else if self.outbox.is_empty() {
            self.state = State::Over;
        } else {
            self.state = State::Closing;
        }
    }

    fn check_timeouts(&mut self, now_ns: u64) {
        if self.state == State::Listening && self.outbox.is_empty() {
            let text = format!(
                "no whole request within {} s: connect again when there is one",
                self.limits.patience_ns as f64 / 1e9
            );
            self.refuse(Reason::BadRequest, text, now_ns);
        } else {
            // It does not read, so there is no way to notify it.
            self.state = State::Over;
        }
    }

    /// Writes what the client takes.
    fn write(&mut self, now_ns: u64) {
        while !self.outbox.is_empty() {
            match self.stream.write(&self.outbox) {
                Ok(count) => {
                    self.outbox.drain(..count);
                    self.deadline_ns = now_ns + self.limits.patience_ns;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return,
                Err(_) => {
                    self.state = State::Over;
                    return;
                }
            }
        }
        match self.state {
            State::Closing => self.state = State::Over,
            State::Answering => self.deadline_ns = u64::MAX,
            _ => {}
        }
    }
}

impl AsFd for Conversation {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }
}
