//! The process that serves a flight to viewers, as the flight's launcher sees it.
//!
//! It listens to the run like any client from outside, so that nothing it does, a stall or a crash,
//! reaches the flight.

use runtime::clock::{mono_now_ns, sleep_until};
use scenario::process::OWN_EXECUTABLE;
use simulate::setup::{LiveOptions, RunError, system};
use std::io::{self, BufRead as _, BufReader, Read};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::Builder;
use std::time::Duration;

/// How long it may take to be there.
const READY_LIMIT: Duration = Duration::from_secs(10);
/// How long it may take to leave once the flight is over \[ns\]: a page that goes on asking has a minute to fetch the end,
/// and then its connection some seconds to close.
const LEAVE_LIMIT_NS: u64 = 70_000_000_000;
/// How often to look whether it has left \[ns\].
const LOOK_EVERY_NS: u64 = 5_000_000;
/// How it begins the line of each address, and how many there are.
const ADDRESS: &str = "live  ";
const ADDRESSES: usize = 2;

/// Serves viewers until dropped.
pub(super) struct ViewerProcess {
    child: Child,
    /// The flight is over, and so is this.
    is_leaving: Arc<AtomicBool>,
}

impl ViewerProcess {
    /// Starts it and waits until it listens.
    pub(super) fn open(
        options: &LiveOptions,
        run: &str,
        cpu: Option<usize>,
    ) -> Result<Self, RunError> {
        let mut command = Command::new(OWN_EXECUTABLE);
        command.arg0("morphquad-live").args(["live", "--run", run]);
        command.args(["--listen", &options.listen.to_string()]);
        if !options.open {
            command.arg("--no-open");
        }
        if let Some(config) = &options.demo {
            command.arg("--demo").arg(config);
        }
        if let Some(cpu) = cpu {
            command.args(["--away-from", &cpu.to_string()]);
        }
        // A process group of its own: Ctrl-C reaches the launcher alone, and this one sees the end.
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
        let child = command.spawn().map_err(system("start the process that serves viewers"))?;
        let mut viewers = Self { child, is_leaving: Arc::default() };
        let failed = || system("start a thread for what viewers print");
        let output = lines(viewers.child.stdout.take()).map_err(failed())?;
        let complaints = lines(viewers.child.stderr.take()).map_err(failed())?;
        viewers.await_addresses(&output, complaints)
    }

    fn await_addresses(
        mut self,
        output: &Receiver<String>,
        complaints: Receiver<String>,
    ) -> Result<Self, RunError> {
        for _ in 0..ADDRESSES {
            match output.recv_timeout(READY_LIMIT) {
                Ok(line) if line.starts_with(ADDRESS) => eprintln!("morphquad: {line}"),
                Ok(_) | Err(RecvTimeoutError::Timeout) => {
                    let reason = "the process that serves viewers does not get ready".to_owned();
                    return Err(RunError::NotServed { reason, exit_code: host::exit::UNFIT });
                }
                Err(RecvTimeoutError::Disconnected) => return Err(self.why_not(&complaints)),
            }
        }
        // What it prints later is passed on until it leaves.
        let is_leaving = Arc::clone(&self.is_leaving);
        let relay = move || {
            for line in complaints {
                eprintln!("{line}");
            }
            if !is_leaving.load(Ordering::Relaxed) {
                eprintln!(
                    "morphquad: the flight is shown no more; `morphquad live` shows it again"
                );
            }
        };
        Builder::new().spawn(relay).map_err(system("start a thread for what viewers print"))?;
        Ok(self)
    }

    fn why_not(&mut self, complaints: &Receiver<String>) -> RunError {
        let lines: Vec<String> = complaints.iter().collect();
        let ended = self.child.wait().ok().and_then(|status| status.code());
        let exit_code = ended.and_then(|code| u8::try_from(code).ok());
        let text = lines.join("\n");
        let reason = text.strip_prefix("morphquad: ").unwrap_or(&text).to_owned();
        RunError::NotServed { reason, exit_code: exit_code.unwrap_or(host::exit::UNFIT) }
    }

    /// From here on it leaves for good reason.
    pub(super) fn flight_is_over(&self) {
        self.is_leaving.store(true, Ordering::Relaxed);
    }

    /// Lets it show the end and leave.
    pub(super) fn leave(mut self) {
        let deadline_ns = mono_now_ns() + LEAVE_LIMIT_NS;
        while mono_now_ns() < deadline_ns && matches!(self.child.try_wait(), Ok(None)) {
            sleep_until(mono_now_ns() + LOOK_EVERY_NS);
        }
    }
}

impl Drop for ViewerProcess {
    fn drop(&mut self) {
        self.flight_is_over();
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What comes out of a pipe, line by line.
fn lines(pipe: Option<impl Read + Send + 'static>) -> io::Result<Receiver<String>> {
    let (sender, receiver) = channel();
    if let Some(pipe) = pipe {
        Builder::new().spawn(move || {
            for line in BufReader::new(pipe).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        })?;
    }
    Ok(receiver)
}
