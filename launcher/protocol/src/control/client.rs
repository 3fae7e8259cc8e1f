//! The other end: asks the launcher of a run and reads its replies.

use super::SOCKET;
use super::protocol::{Reply, Request};
use super::runs::Run;
use core::time::Duration;
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use thiserror::Error;

/// An answer that takes longer than this is none.
const PATIENCE: Duration = Duration::from_secs(5);

/// Longest reply that is read \[bytes\].
const REPLY_BYTES: u64 = 1 << 20;

/// Why a launcher did not answer.
#[derive(Debug, Error)]
pub enum AskError {
    /// No launcher listens.
    #[error(
        "no launcher answers for run {run}: it is just starting, or has died, and then {rescue} ({source})"
    )]
    NoLauncher {
        run: String,
        /// What can be done for it then.
        rescue: String,
        /// The system's error.
        source: io::Error,
    },
    /// It listens, and then nothing.
    #[error("the launcher of run {run} did not answer: {source}; is it stopped?")]
    Silent {
        run: String,
        /// The system's error.
        source: io::Error,
    },
    /// It left.
    #[error("run {run} ended before its launcher had answered")]
    Ended { run: String },
    /// Its replies have another form.
    #[error(
        "the launcher of run {run} answers what this build does not understand: {source}; ask with the executable that flies"
    )]
    NotUnderstood {
        run: String,
        /// The parser's error.
        source: serde_json::Error,
    },
}

/// A request on its way.
#[derive(Debug)]
pub struct Conversation {
    run: String,
    reader: BufReader<UnixStream>,
}

impl Conversation {
    /// Connects to the launcher of `run` and asks.
    ///
    /// # Errors
    /// No launcher listens, or the request cannot be written.
    pub fn ask(run: &Run, request: &Request) -> Result<Self, AskError> {
        let stream = UnixStream::connect(run.folder().join(SOCKET)).map_err(|source| {
            AskError::NoLauncher { run: run.id().to_owned(), rescue: run.rescue(), source }
        })?;
        let mut conversation = Self { run: run.id().to_owned(), reader: BufReader::new(stream) };
        match conversation.send(request) {
            // It has hung up, and perhaps sent why before, which is still there to be read.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(conversation),
            Err(source) => Err(conversation.silent(source)),
            Ok(()) => Ok(conversation),
        }
    }

    fn send(&mut self, request: &Request) -> io::Result<()> {
        let stream = self.reader.get_mut();
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        let mut line = serde_json::to_vec(request)?;
        line.push(b'\n');
        stream.write_all(&line)
    }

    /// Waits for the next reply.
    ///
    /// # Errors
    /// The launcher sends nothing, leaves, or sends what is no reply.
    pub fn receive(&mut self) -> Result<Reply, AskError> {
        let mut line = Vec::new();
        let mut bounded = self.reader.by_ref().take(REPLY_BYTES);
        match bounded.read_until(b'\n', &mut line) {
            // A launcher that leaves before it has let us in resets the connection.
            Err(error) if error.kind() == io::ErrorKind::ConnectionReset => line.clear(),
            Err(source) => return Err(self.silent(source)),
            Ok(_) => {}
        }
        if line.is_empty() {
            return Err(AskError::Ended { run: self.run.clone() });
        }
        let run = self.run.clone();
        serde_json::from_slice(&line).map_err(|source| AskError::NotUnderstood { run, source })
    }

    /// Waits as long as it takes from now on.
    pub fn be_patient(&self) {
        // A socket that does not take this will not answer either.
        let _ = self.reader.get_ref().set_read_timeout(None);
    }

    fn silent(&self, source: io::Error) -> AskError {
        AskError::Silent { run: self.run.clone(), source }
    }
}
