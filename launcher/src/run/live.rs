//! The flight's side of the control plane: what the main loop answers.

use super::conductor::{Conductor, drained_ns};
use super::setup::{RunError, system};
use super::supervisor::{Member, Supervisor, owner_role};
use crate::control::server::{ControlServer, Limits};
use crate::control::status::{ProcessState, ProcessStatus, RunStatus, SlotStatus};
use crate::control::{Reply, Request};
use runtime::clock::mono_now_ns;
use runtime::graph::{Marks, ROLES};
use runtime::{Graph, Node};
use shared_types::{ClockMode, Role};
use std::path::{Path, PathBuf};

/// What is asked about.
pub(super) struct View<'a> {
    pub(super) graph: &'a Graph,
    pub(super) supervisor: &'a Supervisor,
    pub(super) conductor: &'a Conductor,
    pub(super) marks: &'a Marks,
}

/// A mark, and since when it has stood there.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    mark_ns: u64,
    since_mono_ns: u64,
}

/// Answers what is asked of a flight.
pub(super) struct Live {
    server: ControlServer,
    run: String,
    scenario: String,
    recording: Option<PathBuf>,
    seen: [Seen; ROLES],
}

impl Live {
    /// Opens the socket in the run's folder.
    pub(super) fn open(
        folder: &Path,
        run: &str,
        scenario: &str,
        recording: Option<&Path>,
    ) -> Result<Self, RunError> {
        let server = ControlServer::open(folder, Limits::default())
            .map_err(system(format!("open the control socket in {}", folder.display())))?;
        let seen = [Seen { mark_ns: 0, since_mono_ns: mono_now_ns() }; ROLES];
        let recording = recording.map(|path| path.canonicalize().unwrap_or(path.to_path_buf()));
        let (run, scenario) = (run.to_owned(), scenario.to_owned());
        Ok(Self { server, run, scenario, recording, seen })
    }

    /// Answers everything that has been asked; call at every look around.
    pub(super) fn serve(&mut self, view: &View<'_>, now_mono_ns: u64) {
        for (seen, mark_ns) in self.seen.iter_mut().zip(view.marks) {
            if seen.mark_ns != *mark_ns {
                *seen = Seen { mark_ns: *mark_ns, since_mono_ns: now_mono_ns };
            }
        }
        while let Some(asked) = self.server.take() {
            let reply = match asked.request {
                Request::Ps => Reply::Status(self.status(view, now_mono_ns)),
            };
            asked.answer.send(reply);
        }
    }

    fn status(&self, view: &View<'_>, now_mono_ns: u64) -> RunStatus {
        let Self { run, scenario, recording, .. } = self;
        let clock = match view.conductor.mode() {
            ClockMode::Lockstep => "lockstep",
            _ => "realtime",
        };
        let end_ns = view.conductor.end_ns();
        let processes = view.graph.nodes().iter();
        RunStatus {
            run: run.clone(),
            scenario: scenario.clone(),
            clock: clock.to_owned(),
            started: view.conductor.has_started(),
            flown_s: seconds_of(drained_ns(view.graph, view.marks).min(end_ns)),
            end_s: seconds_of(end_ns),
            launcher_pid: std::process::id(),
            recording: recording.clone(),
            processes: processes.map(|node| self.process(view, node, now_mono_ns)).collect(),
            slots: slots(view),
        }
    }

    fn process(&self, view: &View<'_>, node: &Node, now_mono_ns: u64) -> ProcessStatus {
        let member = view.supervisor.crew().find(|member| member.role == node.role);
        let seen = self.seen.get(node.role.index()).copied().unwrap_or_default();
        ProcessStatus {
            name: member.map_or(Role::Pilot.label(), |member| member.name).to_owned(),
            role: node.role.label().to_owned(),
            // The pilot is a thread of this process.
            pid: member.map_or(Some(std::process::id()), |member| member.pid),
            seat: 0,
            generation: member.map_or(0, |member| member.generation),
            rate_hz: node.rate.hz(),
            state: state(view, node.role, member),
            mark_s: seconds_of(seen.mark_ns),
            mark_age_s: seconds_of(now_mono_ns.saturating_sub(seen.since_mono_ns)),
        }
    }
}

fn state(view: &View<'_>, role: Role, member: Option<Member>) -> ProcessState {
    let owns = |(slot, epoch)| epoch > 0 && owner_role(view.graph, slot) == Some(role);
    match member {
        Some(Member { finished: true, .. }) => ProcessState::Finished,
        Some(Member { ready: false, generation: 0, pid: Some(_), .. }) => ProcessState::Starting,
        Some(Member { ready: false, .. }) => ProcessState::Restarting,
        _ if view.supervisor.epochs().any(owns) => ProcessState::Owner,
        _ => ProcessState::Running,
    }
}

fn slots(view: &View<'_>) -> Vec<SlotStatus> {
    let name = |role: Role| {
        let member = view.supervisor.crew().find(|member| member.role == role);
        member.map_or(role.label(), |member| member.name).to_owned()
    };
    let slot = |(role, epoch): (Role, u64)| SlotStatus {
        slot: role.label().to_owned(),
        epoch,
        owner: owner_role(view.graph, role).filter(|_| epoch > 0).map(name),
        fallback: None,
    };
    view.supervisor.epochs().map(slot).collect()
}

fn seconds_of(ns: u64) -> f64 {
    ns as f64 / 1e9
}
