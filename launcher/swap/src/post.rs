//! One supervised process: from its start through its `Hello` to its exit.

use super::standstill::Standstill;
use crate::child::{ChildSpec, RunningChild};
use runtime::ipc::{Bus, PortError, ServiceKind, StatePublisher};
use runtime::leader::process_start;
use runtime::{Place, StateSink as _};
use shared_types::wire::Value as _;
use shared_types::{Handover, Header, Seat};
use std::io;
use std::path::Path;

/// Largest state that can be handed over \[bytes\].
const HANDOVER_CAPACITY: usize = 64 * 1024;

/// A process and the seat that it has.
#[expect(clippy::struct_excessive_bools, reason = "facts of their own, in any combination")]
#[derive(Debug)]
pub struct Post {
    /// Its role and its number within the role.
    pub seat: Seat,
    /// What is started here.
    pub spec: ChildSpec,
    /// The process, while there is one.
    pub child: Option<RunningChild>,
    /// When its process was started, in ticks since the system was.
    pub started: u64,
    /// Processes that have been started here before this one.
    pub generation: u32,
    /// Has sent its hello.
    pub ready: bool,
    /// Has left in order.
    pub finished: bool,
    /// Instant of each restart \[ns\].
    pub restarts: Vec<u64>,
    /// When to start the successor \[ns\].
    pub restart_at_ns: Option<u64>,
    /// How often in a row it has died at one instant of the flight, and at which \[ns\].
    pub died: (u32, u64),
    /// It waits for a hand-over before it begins.
    pub awaits_handover: bool,
    /// It has been given where to begin.
    handed_over: bool,
    /// Its successor goes on from its last state, and no process is notified.
    pub goes_on: bool,
    /// It has been killed on purpose.
    pub scripted: bool,
    /// Layout of the state of the process that was ready here last.
    pub layout: u64,
    /// Its period \[ns\].
    pub period_ns: u64,
    standstill: Option<Standstill>,
    handover: StatePublisher,
}

impl Post {
    /// A post with no process at it yet.
    ///
    /// # Errors
    /// If a service of the transport cannot be opened.
    pub fn open(bus: &Bus, seat: Seat, spec: ChildSpec) -> Result<Self, PortError> {
        let kind = ServiceKind::Handover(seat);
        Ok(Self {
            seat,
            spec,
            child: None,
            started: 0,
            generation: 0,
            ready: false,
            finished: false,
            restarts: Vec::new(),
            restart_at_ns: None,
            died: (0, 0),
            awaits_handover: false,
            handed_over: false,
            goes_on: true,
            scripted: false,
            layout: 0,
            period_ns: 0,
            standstill: None,
            handover: StatePublisher::open(bus, kind, HANDOVER_CAPACITY)?,
        })
    }

    /// Starts the process; it begins at the start of the flight, or waits for a hand-over.
    ///
    /// # Errors
    /// If the process cannot be started.
    pub fn start(&mut self, folder: &Path, awaits_handover: bool) -> io::Result<()> {
        let place = Place { seat: self.seat.index, generation: self.generation };
        let child = RunningChild::start(&self.spec, folder, place, awaits_handover)?;
        self.hold(child, awaits_handover);
        Ok(())
    }

    /// Holds a process that has been started for the seat.
    pub fn hold(&mut self, child: RunningChild, awaits_handover: bool) {
        self.started = process_start(child.pid()).unwrap_or(0);
        self.child = Some(child);
        (self.awaits_handover, self.handed_over) = (awaits_handover, false);
        // What was to be killed before is not this process.
        (self.ready, self.scripted) = (false, false);
        self.standstill = None;
    }

    /// True if a process is the controller that was started for the seat, itself or by a script around it.
    pub fn is_controller(&mut self, pid: u32) -> bool {
        let is_own = self.child.as_mut().is_some_and(|child| child.is_controller(pid));
        if is_own {
            self.started = process_start(pid).unwrap_or(0);
        }
        is_own
    }

    /// True of a process that is there and begins with the flight, or has been given where to begin.
    #[must_use]
    pub fn flies(&self) -> bool {
        self.child.is_some() && self.ready && (self.handed_over || !self.awaits_handover)
    }

    /// Lets a process that waits for it begin.
    pub fn hand_over(&mut self, order: Handover, state: &[u8]) {
        self.handed_over = true;
        let header = Header { generation: self.generation, ..Header::default() };
        let mut bytes = vec![0; Handover::PACKED_SIZE];
        order.pack(&mut bytes);
        bytes.extend_from_slice(state);
        self.handover.send(&header, &bytes);
    }

    /// Lets a process that has just joined see its hand-over.
    pub fn serve_late_joiners(&mut self) {
        self.handover.serve_late_joiners();
    }

    /// Kills a process that stands still at `mark_ns`, unless it only waits for a processor. True if
    /// it was killed.
    pub fn kill_if_hung(&mut self, mark_ns: u64) -> bool {
        let Some(child) = self.child.as_mut().filter(|_| self.ready) else { return false };
        let hung = Standstill::is_hang(&mut self.standstill, child.pid(), mark_ns);
        if hung {
            child.kill();
        }
        hung
    }

    /// The last lines on the process's standard error, for the end of a sentence; call after it has exited.
    pub fn last_stderr(&self) -> String {
        Self::quoted(&self.child.as_ref().map(RunningChild::last_stderr).unwrap_or_default())
    }

    /// The last lines on its standard error until now, for the end of a sentence.
    pub fn stderr_so_far(&self) -> String {
        Self::quoted(&self.child.as_ref().map(RunningChild::stderr_so_far).unwrap_or_default())
    }

    fn quoted(lines: &str) -> String {
        if lines.is_empty() { String::new() } else { format!(", its last words:\n{lines}\n") }
    }
}
