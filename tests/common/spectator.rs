//! A reader of a flight's topics that needs no launcher: what goes on while that is stopped or dead is seen by the
//! processes of the run alone.

use super::time::wait_for;
use runtime::Source as _;
use runtime::ipc::{Bus, IpcSource};
use runtime::namespace::Membership;
use shared_types::{AppliedCommand, Role, Truth, topics};
use std::path::PathBuf;

/// Samples that are kept for the next look, which takes the newest one.
const DEPTH: usize = 4;

/// Reads what the plant publishes. It holds the run for as long as it is there, as each of its processes does.
pub(crate) struct Spectator {
    truth: IpcSource<Truth>,
    applied: IpcSource<AppliedCommand>,
    now: (Truth, AppliedCommand),
    _bus: Bus,
    _membership: Membership,
}

impl Spectator {
    /// Joins a run that still has its launcher.
    pub(crate) fn join(run: &str) -> Self {
        let folder = PathBuf::from(format!("/dev/shm/mq-{run}"));
        let membership = Membership::join(&folder).expect("a run");
        let bus = Bus::join(&membership.ipc_config(), "spectator").expect("a connection");
        Self {
            truth: bus.reader_of(&topics::TRUTH, Role::Plant, DEPTH).expect("a reader"),
            applied: bus.reader_of(&topics::APPLIED_COMMAND, Role::Plant, DEPTH).expect("a reader"),
            now: Default::default(),
            _bus: bus,
            _membership: membership,
        }
    }

    /// The newest of each.
    pub(crate) fn look(&mut self) -> &(Truth, AppliedCommand) {
        while let Some(truth) = self.truth.receive() {
            self.now.0 = truth;
        }
        while let Some(applied) = self.applied.receive() {
            self.now.1 = applied;
        }
        &self.now
    }

    /// Waits until the plant publishes what meets the condition, however long that takes.
    pub(crate) fn wait_until(
        &mut self,
        what: &str,
        is_so: impl Fn(&Truth, &AppliedCommand) -> bool,
    ) {
        wait_for(what, || {
            let (truth, applied) = self.look();
            if is_so(truth, applied) { Ok(()) } else { Err(format!("{truth:?} {applied:?}")) }
        });
    }

    /// Waits until so much more of the flight has been flown \[s\].
    pub(crate) fn fly_on(&mut self, flown_s: f64) {
        self.wait_until("the plant steps", |truth, _| truth.header.release_ns > 0);
        let until_ns = self.now.0.header.release_ns as f64 + 1e9 * flown_s;
        self.wait_until("more of the flight", |truth, _| {
            truth.header.release_ns as f64 >= until_ns
        });
    }
}
