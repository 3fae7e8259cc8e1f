//! The chain as threads of one process, over bounded channels of crossbeam.

use crate::Result;
use crate::chain::{Law, Node, Port, Sample, react};
use crate::node::{self, Flight, Flown};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use std::path::Path;
use std::time::Duration;

/// Samples that a node may be behind by.
const DEPTH: usize = 4096;

/// A node's end of the channels.
struct Channels {
    to: [Sender<Sample>; 5],
    from: Receiver<Sample>,
    recorder: Option<Sender<Sample>>,
    next: Option<Sample>,
}

impl Port for Channels {
    fn send(&mut self, sample: &Sample) -> Result<()> {
        for node in sample.needed_by() {
            // A node that has had the last tick is gone.
            let _ = self.to[node as usize].send(*sample);
        }
        if let Some(recorder) = &self.recorder {
            recorder.send(*sample)?;
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Sample>> {
        Ok(self.next.take().or_else(|| self.from.try_recv().ok()))
    }

    fn wait(&mut self, until_ns: Option<u64>) -> Result<()> {
        let Some(until_ns) = until_ns else {
            self.next = Some(self.from.recv()?);
            return Ok(());
        };
        let left_ns = until_ns.saturating_sub(crate::chain::now_ns());
        match self.from.recv_timeout(Duration::from_nanos(left_ns)) {
            Ok(sample) => self.next = Some(sample),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err("all other nodes have gone".into()),
        }
        Ok(())
    }
}

/// Flies all nodes in this process.
pub fn fly(flight: &Flight) -> Result<Flown> {
    let ends: Vec<_> = Node::ALL.iter().map(|_| bounded(DEPTH)).collect();
    let recorder = flight.record.as_deref().map(|file| (bounded(DEPTH), file.to_path_buf()));
    let port = |node: Node| Channels {
        to: core::array::from_fn(|i| ends[i].0.clone()),
        from: ends[node as usize].1.clone(),
        recorder: recorder.as_ref().map(|((to, _), _)| to.clone()),
        next: None,
    };
    let ticks = flight.ticks;
    let recording = recorder.as_ref().map(|((_, from), file)| {
        let (from, file) = (from.clone(), file.clone());
        std::thread::spawn(move || record(&from, &file, ticks).map_err(|e| e.to_string()))
    });
    let threads: Vec<_> = Node::ALL[1..]
        .iter()
        .map(|&node| {
            let (mut port, flight) = (port(node), flight.clone());
            std::thread::spawn(move || -> core::result::Result<(), String> {
                node::take_place(node, &flight);
                react(&mut Law::new(node, flight.in_lockstep), &mut port).map_err(|e| e.to_string())
            })
        })
        .collect();
    let mut plant = port(Node::Plant);
    node::take_place(Node::Plant, flight);
    node::await_start()?;
    let flown = node::fly_plant(&mut plant, flight)?;
    for thread in threads.into_iter().chain(recording) {
        thread.join().map_err(|_| "a thread panicked")??;
    }
    Ok(flown)
}

fn record(from: &Receiver<Sample>, file: &Path, ticks: u64) -> Result<()> {
    crate::record::leave_pinned_processor();
    let mut writer = crate::record::Recording::create(file)?;
    for _ in 0..crate::chain::recorded_samples(ticks) {
        writer.write(&from.recv()?)?;
    }
    writer.finish()
}
