//! The flight's side of the control plane: what the main loop answers.

use super::conductor::Conductor;
use super::supervisor::{Member, Supervisor};
use protocol::control::server::{Answer, ControlServer, Limits};
use protocol::control::status::{ProcessState, ProcessStatus, RunStatus, SlotStatus};
use protocol::control::{Reply, Request};
use protocol::topic::feed::{Feed, Flying};
use runtime::{Graph, SeatMarks};
use shared_types::time::s_from_ns;
use shared_types::{ClockMode, NO_SEAT, OwnerRecord, Role, Seat};
use simulate::setup::{RunError, system};
use std::collections::BTreeMap;
use std::path::Path;
use swap::Slots;

/// What is asked about.
pub(super) struct View<'a> {
    pub(super) graph: &'a Graph,
    pub(super) supervisor: &'a Supervisor,
    pub(super) slots: &'a Slots,
    pub(super) conductor: &'a Conductor,
    pub(super) marks: &'a SeatMarks,
    /// Everything before it is final and recorded \[ns\].
    pub(super) drained_ns: u64,
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
    /// Until the consumers have it.
    feed: Option<Feed>,
    run: String,
    scenario: String,
    recording: Option<String>,
    seen: BTreeMap<Seat, Seen>,
}

impl Live {
    /// Opens the socket in the run's folder.
    pub(super) fn open(
        folder: &Path,
        run: &str,
        scenario: &str,
        recording: Option<&Path>,
        flying: Flying,
    ) -> Result<Self, RunError> {
        let server = ControlServer::open(folder, Limits::default())
            .map_err(system(format!("open the control socket in {}", folder.display())))?;
        let feed = Feed::open(folder, flying)
            .map_err(system(format!("open the socket for topics in {}", folder.display())))?;
        let seen = BTreeMap::new();
        let recording = recording
            .map(|path| path.canonicalize().unwrap_or(path.to_path_buf()).display().to_string());
        let (run, scenario) = (run.to_owned(), scenario.to_owned());
        Ok(Self { server, feed: Some(feed), run, scenario, recording, seen })
    }

    /// Where samples go that a client wants to see.
    pub(super) fn take_feed(&mut self) -> Option<Feed> {
        self.feed.take()
    }

    /// Answers everything that has been asked, and gives back the orders; call at every look around.
    pub(super) fn serve(&mut self, view: &View<'_>, now_mono_ns: u64) -> Vec<(Request, Answer)> {
        let mut orders = Vec::new();
        for member in view.supervisor.members() {
            let mark_ns = view.marks.of_seat(member.seat, member.generation);
            let begun = Seen { mark_ns, since_mono_ns: now_mono_ns };
            let seen = self.seen.entry(member.seat).or_insert(begun);
            if seen.mark_ns != mark_ns {
                *seen = begun;
            }
        }
        while let Some(asked) = self.server.take() {
            match asked.request {
                Request::Ps => asked.answer.send(Reply::Status(self.status(view, now_mono_ns))),
                order => orders.push((order, asked.answer)),
            }
        }
        orders
    }

    fn status(&self, view: &View<'_>, now_mono_ns: u64) -> RunStatus {
        let Self { run, scenario, recording, .. } = self;
        let clock = match view.conductor.mode() {
            ClockMode::Lockstep => "lockstep",
            _ => "realtime",
        };
        let end_ns = view.conductor.end_ns();
        RunStatus {
            run: run.clone(),
            scenario: scenario.clone(),
            clock: clock.to_owned(),
            started: view.conductor.has_started(),
            flown_s: s_from_ns(view.drained_ns.min(end_ns)),
            end_s: s_from_ns(end_ns),
            launcher_pid: std::process::id(),
            recording: recording.clone(),
            processes: view
                .supervisor
                .members()
                .map(|member| self.process(view, member, now_mono_ns))
                .collect(),
            slots: slots(view),
        }
    }

    fn process(&self, view: &View<'_>, member: Member<'_>, now_mono_ns: u64) -> ProcessStatus {
        let Seat { role, index } = member.seat;
        let seen = self.seen.get(&member.seat).copied().unwrap_or_default();
        // The last mark of one that leaves means that nothing will follow.
        let flown_ns = view.drained_ns.min(view.conductor.end_ns());
        let mark_ns = if seen.mark_ns == u64::MAX { flown_ns } else { seen.mark_ns };
        ProcessStatus {
            name: member.name.to_owned(),
            role: role.label().to_owned(),
            pid: member.pid,
            seat: index,
            generation: member.generation,
            rate_hz: view.graph.node(role).map_or(0.0, |node| node.rate.hz()),
            state: state(view, member),
            mark_s: s_from_ns(mark_ns),
            mark_age_s: s_from_ns(now_mono_ns.saturating_sub(seen.since_mono_ns)),
        }
    }
}

impl View<'_> {
    /// Name of the process that sits on a seat of a slot.
    fn name_on(&self, slot: Role, index: u32) -> Option<String> {
        let seat = Seat { role: self.graph.slot_holder(slot), index };
        let member = self.supervisor.members().find(|member| member.seat == seat)?;
        Some(member.name.to_owned())
    }
}

fn state(view: &View<'_>, member: Member<'_>) -> ProcessState {
    let Seat { role, index } = member.seat;
    let record = view.supervisor.owners().find(|r| view.graph.slot_holder(r.slot) == role);
    match member {
        Member { finished: true, .. } => ProcessState::Finished,
        Member { ready: false, generation: 0, pid: Some(_), .. } => ProcessState::Starting,
        Member { ready: false, .. } => ProcessState::Restarting,
        _ => match record {
            Some(record) if record.owner == index => ProcessState::Owner,
            Some(record) if record.fallback == index => ProcessState::Fallback,
            Some(_) => ProcessState::Shadow,
            None => ProcessState::Running,
        },
    }
}

fn slots(view: &View<'_>) -> Vec<SlotStatus> {
    let slot = |record: &OwnerRecord| {
        let (stage, candidate, until_ns) = view.slots.progress(record.slot);
        SlotStatus {
            slot: record.slot.label().to_owned(),
            epoch: record.epoch,
            owner: view.name_on(record.slot, record.owner),
            fallback: Some(record.fallback)
                .filter(|seat| *seat != NO_SEAT)
                .and_then(|seat| view.name_on(record.slot, seat)),
            watched: record.watched.is_set(),
            stage: stage.to_owned(),
            candidate,
            until_s: until_ns.map(s_from_ns),
        }
    };
    view.supervisor.owners().map(slot).collect()
}
