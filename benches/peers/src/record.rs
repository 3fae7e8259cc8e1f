//! What a user of a bare transport would write to keep everything: an MCAP file, compressed by Zstandard.

use crate::Result;
use crate::chain::{Sample, Topic, now_ns};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use rustix::thread::{CpuSet, sched_setaffinity};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

pub struct Recording {
    writer: Writer<BufWriter<File>>,
    channels: [u16; 6],
    sequences: [u32; 6],
}

impl Recording {
    pub fn create(file: &Path) -> Result<Self> {
        let options = WriteOptions::new().compression(Some(Compression::Zstd));
        let mut writer = options.create(BufWriter::new(File::create(file)?))?;
        let mut channels = [0; 6];
        for topic in Topic::ALL {
            channels[topic as usize] =
                writer.add_channel(0, topic.name(), "raw", &BTreeMap::new())?;
        }
        Ok(Self { writer, channels, sequences: [0; 6] })
    }

    pub fn write(&mut self, sample: &Sample) -> Result<()> {
        let topic = sample.topic().ok_or("an unknown topic")? as usize;
        self.sequences[topic] += 1;
        let header = MessageHeader {
            channel_id: self.channels[topic],
            sequence: self.sequences[topic],
            log_time: now_ns(),
            publish_time: sample.stamp_ns,
        };
        Ok(self.writer.write_to_known_channel(&header, &sample.to_bytes())?)
    }

    pub fn finish(mut self) -> Result<()> {
        self.writer.finish()?;
        Ok(())
    }
}

/// A recorder runs where there is room, wherever the nodes are pinned.
pub fn leave_pinned_processor() {
    let mut all = CpuSet::new();
    for cpu in 0..CpuSet::MAX_CPU {
        all.set(cpu);
    }
    let _ = sched_setaffinity(None, &all);
}
