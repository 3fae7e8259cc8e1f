//! The other end: listens to topics of a running flight.

use super::feed::{Answer, DROPPED, ENDED, Ending, Flying, LOG, Listen};
use super::{SOCKET, schema};
use crate::control::runs::Run;
use core::time::Duration;
use shared_types::{TopicInfo, topics};
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixStream;
use thiserror::Error;

/// An answer that takes longer than this is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// The largest sample there is, with a margin \[bytes\].
const LARGEST: usize = 1 << 20;

/// Why nothing can be received.
#[derive(Debug, Error)]
pub enum ListenError {
    /// No launcher is there.
    #[error(
        "run {run} cannot be listened to: {source}; it is just starting, or its launcher has died"
    )]
    Closed {
        run: String,
        /// The system's error.
        source: io::Error,
    },
    /// It refuses.
    #[error("{0}")]
    Refused(String),
    /// Its answer has another form.
    #[error(
        "run {run} sends what this build does not understand: ask with the executable that flies"
    )]
    NotUnderstood { run: String },
}

/// Something received.
#[derive(Debug, Clone)]
pub enum Message {
    /// A packed sample.
    Sample(&'static TopicInfo, Vec<u8>),
    /// So many were not sent, because the client did not read fast enough.
    Dropped(u64),
    /// Something that happened, as `foxglove.Log`.
    Log(Vec<u8>),
    /// How the flight has ended.
    Ended(Ending),
    /// Nothing within the time given.
    Nothing,
    /// The flight is over.
    Over,
}

/// A conversation under way.
#[derive(Debug)]
pub struct Listening {
    run: String,
    reader: BufReader<UnixStream>,
    /// What has come of the next frame.
    partial: Vec<u8>,
    flying: Flying,
}

impl Listening {
    /// Asks the launcher of `run` for topics, and perhaps for events.
    ///
    /// # Errors
    /// [`ListenError`].
    pub fn to(run: &Run, wanted: &[&'static TopicInfo], events: bool) -> Result<Self, ListenError> {
        let closed = |source| ListenError::Closed { run: run.id().to_owned(), source };
        let stream = UnixStream::connect(run.folder().join(SOCKET)).map_err(closed)?;
        stream.set_read_timeout(Some(PATIENCE)).map_err(closed)?;
        let layout = |topic: &TopicInfo| schema(topic).map_or(0, |schema| schema.layout_hash);
        let named = wanted.iter();
        let listen =
            named.map(|topic| (topic.name.to_owned(), format!("{:016x}", layout(topic)))).collect();
        let mut line =
            serde_json::to_vec(&Listen { listen, events }).map_err(|e| closed(e.into()))?;
        line.push(b'\n');
        let mut reader = BufReader::new(stream);
        let asked = reader.get_mut().write_all(&line);
        let mut answer = String::new();
        // It may have hung up and sent why before, which is still there to be read.
        let read = reader.read_line(&mut answer);
        if answer.is_empty() {
            asked.map_err(closed)?;
        }
        read.map_err(closed)?;
        match serde_json::from_str::<Answer>(&answer) {
            Ok(Answer { error: None, flight: Some(flying) }) => {
                Ok(Self { run: run.id().to_owned(), reader, partial: Vec::new(), flying })
            }
            Ok(Answer { error: Some(error), .. }) => Err(ListenError::Refused(error)),
            Ok(_) | Err(_) => Err(ListenError::NotUnderstood { run: run.id().to_owned() }),
        }
    }

    /// Asks for everything there is: topics, events, and how it ends.
    ///
    /// # Errors
    /// [`ListenError`].
    pub fn to_everything(run: &Run) -> Result<Self, ListenError> {
        Self::to(run, &topics::all(), true)
    }

    /// How the flight's time stands to the clock on the wall.
    #[must_use]
    pub fn flying(&self) -> Flying {
        self.flying
    }

    /// Waits for the next thing, at most so long.
    ///
    /// # Errors
    /// The launcher sends what is no sample.
    pub fn next(&mut self, patience: Duration) -> Result<Message, ListenError> {
        let not_understood = || ListenError::NotUnderstood { run: self.run.clone() };
        // A time of zero would be none at all.
        let patience = patience.max(Duration::from_micros(100));
        if self.reader.get_ref().set_read_timeout(Some(patience)).is_err() {
            return Ok(Message::Over);
        }
        if let Some(end) = fill(&mut self.reader, &mut self.partial, 6) {
            return Ok(end);
        }
        let topic = u16::from_le_bytes([self.partial[0], self.partial[1]]);
        let length = [2, 3, 4, 5].map(|at| self.partial[at]);
        let length = usize::try_from(u32::from_le_bytes(length)).unwrap_or(usize::MAX);
        if length > LARGEST {
            return Err(not_understood());
        }
        if let Some(end) = fill(&mut self.reader, &mut self.partial, 6 + length) {
            return Ok(end);
        }
        let packed = self.partial.split_off(6);
        self.partial.clear();
        match topic {
            DROPPED => {
                let count = packed.try_into().map(u64::from_le_bytes);
                return count.map(Message::Dropped).map_err(|_| not_understood());
            }
            LOG => return Ok(Message::Log(packed)),
            ENDED => {
                let ending = serde_json::from_slice(&packed);
                return ending.map(Message::Ended).map_err(|_| not_understood());
            }
            _ => {}
        }
        let topic = topics::all().get(usize::from(topic)).copied().ok_or_else(not_understood)?;
        Ok(Message::Sample(topic, packed))
    }
}

/// Reads until `partial` has `length` bytes; otherwise what ended it before.
fn fill(reader: &mut impl io::Read, partial: &mut Vec<u8>, length: usize) -> Option<Message> {
    while partial.len() < length {
        let missing = length - partial.len();
        let mut chunk = [0; 8192];
        let room = missing.min(chunk.len());
        match reader.read(&mut chunk[..room]) {
            Ok(0) => return Some(Message::Over),
            Ok(count) => partial.extend_from_slice(&chunk[..count]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error)
                if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) =>
            {
                return Some(Message::Nothing);
            }
            Err(_) => return Some(Message::Over),
        }
    }
    None
}
