//! The chain as processes, over unix sockets that keep messages whole.

use crate::Result;
use crate::chain::{Node, Port, Sample};
use rustix::event::{PollFd, PollFlags, poll};
use std::io::ErrorKind;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};

/// A node's socket and where the others' are.
pub struct Sockets {
    own: UnixDatagram,
    to: [PathBuf; 5],
    recorder: Option<PathBuf>,
}

fn address(folder: &Path, name: &str) -> PathBuf {
    folder.join(name)
}

fn bind(folder: &Path, name: &str) -> Result<UnixDatagram> {
    let own = UnixDatagram::bind(address(folder, name))?;
    Ok(own)
}

impl Sockets {
    pub fn open(folder: &Path, node: Node, records: bool) -> Result<Self> {
        let to = Node::ALL.map(|node| address(folder, node.name()));
        let recorder = records.then(|| address(folder, "recorder"));
        Ok(Self { own: bind(folder, node.name())?, to, recorder })
    }
}

impl Port for Sockets {
    fn send(&mut self, sample: &Sample) -> Result<()> {
        let bytes = sample.to_bytes();
        for node in sample.needed_by() {
            match self.own.send_to(&bytes, &self.to[node as usize]) {
                // One that has had the last tick is gone.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                sent => _ = sent?,
            }
        }
        if let Some(recorder) = &self.recorder {
            self.own.send_to(&bytes, recorder)?;
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<Sample>> {
        receive(&self.own, rustix::net::RecvFlags::DONTWAIT)
    }

    fn wait(&mut self, until_ns: Option<u64>) -> Result<()> {
        let limit = until_ns.map(crate::node::left_until);
        poll(&mut [PollFd::new(&self.own, PollFlags::IN)], limit.as_ref())?;
        Ok(())
    }
}

fn receive(own: &UnixDatagram, flags: rustix::net::RecvFlags) -> Result<Option<Sample>> {
    let mut bytes = [0; Sample::SIZE];
    match rustix::net::recv(own, &mut bytes, flags) {
        Ok((_, length)) if length == Sample::SIZE => Ok(Some(Sample::from_bytes(&bytes))),
        Ok((_, length)) => Err(format!("a message of {length} bytes").into()),
        Err(rustix::io::Errno::AGAIN) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The recorder's end.
pub struct Inbox(UnixDatagram);

impl Inbox {
    pub fn open(folder: &Path) -> Result<Self> {
        Ok(Self(bind(folder, "recorder")?))
    }

    pub fn next(&self) -> Result<Sample> {
        receive(&self.0, rustix::net::RecvFlags::empty())?.ok_or_else(|| "nothing came".into())
    }
}
