//! The file behind a recording: after the first error, or once closed, it takes no more bytes.
//!
//! Without this, writers that finish their file when dropped would append to a torn record, or
//! make an abandoned recording look complete.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Closes a [`Sink`] from outside the writers that own it.
#[derive(Debug, Clone, Default)]
pub(super) struct Valve(Arc<AtomicBool>);

impl Valve {
    pub(super) fn close(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

pub(super) struct Sink {
    inner: Box<dyn Write + Send>,
    valve: Valve,
}

impl Sink {
    pub(super) fn new(inner: Box<dyn Write + Send>, valve: Valve) -> Self {
        Self { inner, valve }
    }

    fn guarded<T>(&mut self, act: impl FnOnce(&mut dyn Write) -> io::Result<T>) -> io::Result<T> {
        if self.valve.0.load(Ordering::Relaxed) {
            return Err(io::Error::other("the recording is closed"));
        }
        let result = act(&mut self.inner);
        if result.as_ref().is_err_and(|e| e.kind() != io::ErrorKind::Interrupted) {
            self.valve.close();
        }
        result
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.guarded(|inner| inner.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.guarded(|inner| inner.flush())
    }
}
