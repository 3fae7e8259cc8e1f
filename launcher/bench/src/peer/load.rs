//! Something else for the machine to do while it is measured: ordinary programs, one per processor.

use super::{Peer, PeerRequest, Seat, Talk, not_answered};
use crate::BenchError;
use crate::place::Place;
use core::hint::black_box;
use core::sync::atomic::{AtomicBool, Ordering};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, Seek as _, Write as _};
use std::thread;

/// Words of the block that memory load goes through, more than caches hold.
const BLOCK_WORDS: usize = 8 << 20;
/// Bytes of a write to the disk, and of the file before it begins anew.
const WRITE_BYTES: usize = 1 << 20;
const FILE_BYTES: usize = 64 << 20;

/// What to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Load {
    /// Nothing
    None,
    /// Compute
    Cpu,
    /// Move memory
    Mem,
    /// Write files, to the disk at once
    Io,
}

impl Load {
    /// As it is written.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Cpu => "cpu",
            Self::Mem => "mem",
            Self::Io => "io",
        }
    }

    /// Begins on every processor of the place; it ends when what is returned is stopped, or dropped.
    ///
    /// # Errors
    /// A program cannot be started.
    pub fn begin(self, place: &Place) -> Result<Vec<Peer>, BenchError> {
        if self == Self::None {
            return Ok(Vec::new());
        }
        let seat = |cpu: &usize| Seat { cpu: Some(*cpu), ..Seat::default() };
        let order = |cpu: &usize| LoadOrder { load: self, seat: seat(cpu) };
        place.cpus.iter().map(|cpu| Peer::start(&PeerRequest::Load(order(cpu)))).collect()
    }
}

/// What one program is to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LoadOrder {
    load: Load,
    seat: Seat,
}

/// Loads the machine until no process listens any more.
///
/// # Errors
/// The file cannot be written.
pub fn be_load(order: &LoadOrder, talk: &mut Talk) -> Result<String, BenchError> {
    let full = |source| BenchError::System {
        action: format!("write a file in {} for --load io", std::env::temp_dir().display()),
        source,
    };
    // It has no name, so that nothing is left behind.
    let file = (order.load == Load::Io).then(tempfile::tempfile).transpose().map_err(full)?;
    talk.ready().map_err(not_answered)?;
    let going = AtomicBool::new(true);
    thread::scope(|scope| {
        let work = scope.spawn(|| {
            order.seat.take("load");
            if let Some(file) = file {
                return write(file, &going);
            }
            compute(order.load, &going);
            Ok(())
        });
        while talk.next_line().is_some() {}
        going.store(false, Ordering::Relaxed);
        work.join()
            .map_or_else(|_| Err(BenchError::Peer("died".to_owned())), |done| done.map_err(full))
    })?;
    Ok("null".to_owned())
}

fn compute(load: Load, going: &AtomicBool) {
    let mut block = vec![1_u64; if load == Load::Mem { BLOCK_WORDS } else { 1024 }];
    while going.load(Ordering::Relaxed) {
        for word in &mut block {
            *word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        }
        black_box(&block);
    }
}

fn write(mut file: File, going: &AtomicBool) -> io::Result<()> {
    let bytes = vec![0_u8; WRITE_BYTES];
    let mut written = 0;
    while going.load(Ordering::Relaxed) {
        file.write_all(&bytes)?;
        file.sync_data()?;
        written += WRITE_BYTES;
        if written >= FILE_BYTES {
            file.set_len(0)?;
            file.rewind()?;
            written = 0;
        }
    }
    Ok(())
}
