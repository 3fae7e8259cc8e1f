//! What sits in the slots of a flight in one process: loops of its thread, and processes.

use super::InProcessError;
use super::loops::{Connect, Loop};
use super::marks::FlightMarks;
use super::outside::{ExitReport, Outside, OutsideLoop, Start};
use super::stepper::InstanceMark;
use super::wires::Wires;
use crate::rehearse::{self, Snapshot, Verdict};
use core::cell::RefCell;
use runtime::clock::mono_now_ns;
use runtime::{Graph, Node, StateHeader};
use scenario::Scenario;
use scenario::orders::Sent;
use shared_types::time::ns_from_s;
use shared_types::{
    Flag, Handover, Header, OwnerRecord, Role, Seat as Place, Seating, Slot, topics,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use swap::child::{ChildSpec, Launch};
use swap::{FlightError, PostEvent, Posts, RehearsalSpec, Seen, SlotWatch};

/// Deaths of a process at one instant after which it is not started again in place.
const DEATHS_MAX: u32 = 2;

/// A seat of a slot, and what has had it.
#[derive(Debug)]
pub(super) struct Post {
    spec: ChildSpec,
    generation: u32,
    /// The last state published there, and by which generation.
    last_state: Option<(u32, Vec<u8>)>,
    /// How often in a row its process has died at one instant, and at which \[ns\].
    died: (u32, u64),
}

/// The processes of a flight in one thread, and what is needed to start others.
pub(super) struct InProcessHost {
    pub(super) scenario: Scenario,
    pub(super) wires: Wires,
    outside: Outside,
    watch: Rc<RefCell<SlotWatch>>,
    posts: BTreeMap<Place, Post>,
    pub(super) events: Vec<PostEvent>,
    /// Those that are being started: a process opens its ports when all that happens at an instant has
    /// happened, and so one that dies then has left nothing for it.
    starting: Vec<Place>,
    /// The newest owner record of each slot.
    records: BTreeMap<Role, OwnerRecord>,
    /// Verdicts about candidates that have been flown ahead.
    rehearsed: Vec<(Place, Verdict)>,
    /// Processes that have failed.
    pub(super) exits: Vec<ExitReport>,
}

impl InProcessHost {
    /// Before any process is there.
    pub(super) fn new(
        scenario: &Scenario,
        wires: Wires,
        watch: Rc<RefCell<SlotWatch>>,
        outside: &Outside,
    ) -> Self {
        Self {
            scenario: scenario.clone(),
            wires,
            outside: outside.clone(),
            watch,
            posts: BTreeMap::new(),
            events: Vec::new(),
            starting: Vec::new(),
            records: BTreeMap::new(),
            rehearsed: Vec::new(),
            exits: Vec::new(),
        }
    }

    /// Takes in a loop that flies from the start, and returns how its service would be started.
    pub(super) fn register_initial(&mut self, l: &Loop, name: &str) -> ChildSpec {
        let spec = ChildSpec {
            name: name.to_owned(),
            executable: self.outside.services.clone().unwrap_or_default(),
            launch: Launch::Service { config: None },
            cpu: self.outside.cpu,
            nice: self.outside.nice,
            pause_ns: 0,
        };
        let post = Post { spec: spec.clone(), generation: 0, last_state: None, died: (0, 0) };
        self.posts.insert(l.place, post);
        self.events.push(l.joined());
        spec
    }

    /// Starts those that are to be started; false if there are none.
    pub(super) fn start_all(
        &mut self,
        graph: &Graph,
        loops: &mut Vec<Loop>,
        marks: &mut FlightMarks,
    ) -> bool {
        let starting = core::mem::take(&mut self.starting);
        let mut processes = Vec::new();
        for &place in &starting {
            let Some(Post { spec, generation, .. }) = self.posts.get(&place) else { continue };
            let (spec, generation) = (spec.clone(), *generation);
            let Some(node) = graph.node(place.role).copied() else { continue };
            let started = if spec.executable == PathBuf::new() {
                self.build(graph, node, (place, generation), &spec).map(|l| {
                    self.events.push(l.joined());
                    loops.push(Loop { waits: true, ..l });
                })
            } else {
                self.spawn(graph, (place, generation), &spec)
                    .map(|process| processes.push(((node, place, generation), process)))
            };
            // What is ordered in flight never ends the flight.
            let exit_reason = started.err().map(|error| error.to_string());
            marks.seat(place, generation, exit_reason.is_none());
            if exit_reason.is_some() {
                self.events.push(PostEvent::Gone { place, exit_reason });
            }
        }
        // They open their ports side by side.
        for (member, mut process) in processes {
            let is_ready = process.await_ready();
            let l = Loop::outside(member, process);
            if is_ready {
                self.events.push(l.joined());
            }
            loops.push(l);
        }
        !starting.is_empty()
    }

    /// True if a loop has come or gone, or a candidate has been flown ahead, since the last time.
    pub(super) fn has_news(&self) -> bool {
        !self.events.is_empty() || !self.rehearsed.is_empty()
    }

    /// A service within the flight's thread.
    fn build(
        &mut self,
        graph: &Graph,
        node: Node,
        (place, generation): (Place, u32),
        spec: &ChildSpec,
    ) -> Result<Loop, InProcessError> {
        let refused = |error: String| InProcessError::Component { role: place.role.label(), error };
        let own = match &spec.launch {
            Launch::Service { config: Some(path) } => {
                let scenario = Scenario::load(&path.to_string_lossy(), &[]);
                Some(scenario.map_err(|error| refused(error.to_string()))?)
            }
            _ => None,
        };
        let wires = &mut self.wires;
        let scenario = own.as_ref().unwrap_or(&self.scenario);
        let built = components::build_service(&spec.name, scenario);
        let component = built.map_err(|error| refused(error.to_string()))?;
        let name = &spec.name;
        Connect { graph, node, place, generation, name, wires, from: None }.connect(component)
    }

    fn spawn(
        &mut self,
        graph: &Graph,
        (place, generation): (Place, u32),
        spec: &ChildSpec,
    ) -> Result<OutsideLoop, InProcessError> {
        let Self { scenario, outside, wires, .. } = self;
        let start = Start { scenario, graph, outside, spec, place, generation };
        OutsideLoop::start(start, wires)
            .map_err(|error| InProcessError::Outside { name: spec.name.clone(), error })
    }

    /// A loop is gone, perhaps for a reason that is reported: no other waits for it.
    pub(super) fn reap(&mut self, mut l: Loop, marks: &mut FlightMarks) {
        marks.seat(l.place, l.generation, false);
        let exit_reason = l.stepper.take_failure().map(|report| {
            let text = report.to_string();
            self.exits.push(report);
            text
        });
        self.events.push(PostEvent::Gone { place: l.place, exit_reason });
    }

    /// The last state of a loop stays when it is gone.
    pub(super) fn keep_state(&mut self, l: &mut Loop) {
        let Some(state) = l.state() else { return };
        if let Some(post) = self.posts.get_mut(&l.place) {
            post.last_state = Some((l.generation, state));
        }
    }

    /// As [`keep_state`](Self::keep_state), of a loop that does not leave in order.
    fn keep_last_state(&mut self, l: &mut Loop) {
        self.keep_state(l);
        if let Some((generation, state)) =
            self.posts.get(&l.place).and_then(|post| post.last_state.as_ref())
        {
            self.show_state((l.place, *generation), state);
        }
    }

    /// Shows the observer the last state of a process, or one that another goes on from.
    fn show_state(&self, (place, generation): (Place, u32), state: &[u8]) {
        let Some(head) = StateHeader::of(state) else { return };
        let header = Header {
            sequence: head.state_sequence,
            release_ns: head.release_ns,
            valid_ns: head.release_ns,
            seat: place.index,
            generation,
            ..Header::default()
        };
        self.wires.observer().keep_state(place.role, &header, state);
    }

    /// Starts a process that has failed again, from its last state, if it commands or may have to: time
    /// waits for it. Gives it back if it is not, or fails again.
    pub(super) fn restart(
        &mut self,
        graph: &Graph,
        mut l: Loop,
        instances: &[InstanceMark],
        marks: &mut FlightMarks,
    ) -> Result<RestartOutcome, InProcessError> {
        let place = l.place;
        let commands = self
            .records
            .get(&place.role)
            .is_some_and(|record| record.owner == place.index || record.fallback == place.index);
        self.keep_last_state(&mut l);
        let mark_ns = l.stepper.next_ns();
        let Some(post) = self.posts.get_mut(&place).filter(|_| commands) else {
            return Ok(RestartOutcome::Gone(l));
        };
        // A loop that dies of what it meets there would do so again and again.
        let (times, there_ns) = post.died;
        post.died = if mark_ns > there_ns { (1, mark_ns) } else { (times + 1, there_ns) };
        // One that died before its first state has left that of the process before it.
        let layout = l.stepper.layout();
        let state =
            post.last_state.clone().filter(|(_, state)| StateHeader::has_layout(state, layout));
        let Some((_, state)) = state.filter(|_| post.died.0 <= DEATHS_MAX) else {
            post.died = (0, 0);
            return Ok(RestartOutcome::Gone(l));
        };
        post.generation += 1;
        let (spec, generation) = (post.spec.clone(), post.generation);
        let Loop { node, leave_ns, .. } = l;
        let report = l.stepper.take_failure();
        // Its ports are closed before its successor's are opened.
        drop(l);
        let mut process = self.spawn(graph, (place, generation), &spec)?;
        let is_ready = process.await_ready();
        let mut l = Loop { leave_ns, ..Loop::outside((node, place, generation), process) };
        marks.seat(place, generation, true);
        if is_ready {
            let order = Handover { has_state: Flag::Yes, ..Handover::default() };
            let order = marks.name_writers(order, &state);
            let begun = l.stepper.begin(&order, &state, instances);
            l.waits = begun.is_err() || l.stepper.has_failed();
            marks.advance(place, generation, l.stepper.next_ns());
        }
        let text = report.map(|report| {
            let text = format!("{report}; restarting it from its last state");
            self.exits.push(report);
            text
        });
        Ok(RestartOutcome::Restarted(l, text.unwrap_or_default()))
    }
}

/// What has become of a loop whose process has failed.
pub(super) enum RestartOutcome {
    /// Another process goes on in its place, and the notice of that.
    Restarted(Loop, String),
    /// It is gone.
    Gone(Loop),
}

/// Loops on seats.
pub(super) struct Seats<'a> {
    pub(super) loops: &'a mut Vec<Loop>,
    pub(super) marks: &'a mut FlightMarks,
    pub(super) host: &'a mut InProcessHost,
    pub(super) recovered: &'a mut u64,
}

impl Seats<'_> {
    fn start(&mut self, place: Place, spec: ChildSpec) {
        let host = &mut *self.host;
        let generation = host.posts.get(&place).map_or(0, |post| post.generation + 1);
        let last_state = host.posts.remove(&place).and_then(|post| post.last_state);
        host.posts.insert(place, Post { spec, generation, last_state, died: (0, 0) });
        host.starting.push(place);
    }

    fn at(&self, place: Place) -> Option<usize> {
        self.loops.iter().position(|l| l.place == place)
    }
}

impl Posts for Seats<'_> {
    fn spawn(&mut self, place: Place, spec: ChildSpec) {
        self.start(place, spec);
    }

    fn restart(&mut self, place: Place) -> Result<(), FlightError> {
        *self.recovered += 1;
        let spec = self.host.posts.get(&place).map(|post| post.spec.clone());
        if let Some(spec) = spec {
            self.start(place, spec);
        }
        Ok(())
    }

    fn announce(&mut self, record: OwnerRecord) {
        let role = record.slot;
        if let Some(slot) = Slot::of(role) {
            self.host.wires.announce(slot.spec().owner, record);
        }
        self.host.records.insert(role, record);
        let FlightMarks::Seats(marks) = &mut *self.marks else { return };
        let Some(book) = marks.book(role) else { return };
        book.learn(&record);
        for l in self.loops.iter_mut().filter(|l| l.place.role == role) {
            l.leave_ns = book.released_ns(l.place.index).unwrap_or(u64::MAX);
        }
    }

    fn hand_over(
        &mut self,
        place: Place,
        order: Handover,
        state: &[u8],
    ) -> Result<(), FlightError> {
        let Some(at) = self.at(place) else { return Ok(()) };
        let instances = flying(self.loops);
        let order = self.marks.name_writers(order, state);
        let Some(l) = self.loops.get_mut(at) else { return Ok(()) };
        let begun = l.stepper.begin(&order, state, &instances);
        l.waits = l.stepper.has_failed();
        self.marks.advance(place, l.generation, l.stepper.next_ns());
        begun.map_err(|error| FlightError::NotReady {
            name: place.label(),
            how: error.to_string(),
            last_stderr: String::new(),
        })
    }

    fn last_state(&mut self, place: Place) -> Option<(u32, Vec<u8>)> {
        let at = self.at(place);
        let there = at.and_then(|at| {
            let l = &mut self.loops[at];
            Some((l.generation, l.state()?))
        });
        let (generation, state) =
            there.or_else(|| self.host.posts.get(&place)?.last_state.clone())?;
        self.host.show_state((place, generation), &state);
        Some((generation, state))
    }

    fn kill(&mut self, place: Place) {
        if let Some(at) = self.host.starting.iter().position(|starting| *starting == place) {
            self.host.starting.remove(at);
            self.host.events.push(PostEvent::Gone { place, exit_reason: None });
        } else if let Some(at) = self.at(place) {
            let mut l = self.loops.remove(at);
            if l.stepper.next_ns() >= self.host.scenario.duration_ns() {
                // It has flown to the end, where a process has published its totals already.
                l.stepper.finish();
            }
            self.host.keep_last_state(&mut l);
            self.host.reap(l, self.marks);
        }
    }

    fn kill_at_once(&mut self, place: Place) {
        self.kill(place);
    }

    fn stop(&mut self, place: Place) {
        if let Some(at) = self.at(place) {
            let l = &mut self.loops[at];
            l.waits = true;
            self.marks.seat(place, l.generation, false);
        }
    }

    fn stderr_so_far(&self, _place: Place) -> String {
        // A process that fails here is waited for, and its exit report has its last lines.
        String::new()
    }

    fn seat_of(&self, name: &str) -> Option<Place> {
        self.host.posts.iter().find(|(_, post)| post.spec.name == name).map(|(place, _)| *place)
    }

    fn generation(&self, place: Place) -> Option<u32> {
        self.host.posts.get(&place).map(|post| post.generation)
    }

    fn take_events(&mut self) -> Vec<PostEvent> {
        core::mem::take(&mut self.host.events)
    }

    fn take_seen(&mut self) -> Vec<Seen> {
        self.host.watch.borrow_mut().take()
    }

    fn snapshot(&self, at_ns: u64) -> Option<Snapshot> {
        self.host.watch.borrow().snapshot(at_ns)
    }

    fn tracking_error_m(&self, at_ns: u64) -> Option<f64> {
        self.host.watch.borrow().tracking_error_m(at_ns)
    }

    fn rehearse(
        &mut self,
        place: Place,
        spec: RehearsalSpec,
        wall_max_s: f64,
    ) -> Result<(), String> {
        // Time stands still until the verdict, so it may as well be awaited here.
        let end_ns = mono_now_ns().saturating_add(ns_from_s(wall_max_s));
        let verdict = rehearse::verdict(spec, &mut || mono_now_ns() < end_ns);
        self.host.rehearsed.push((place, verdict));
        Ok(())
    }

    fn end_rehearsal(&mut self, place: Place) {
        self.host.rehearsed.retain(|(of, _)| *of != place);
    }

    fn take_rehearsed(&mut self) -> Vec<(Place, Verdict)> {
        core::mem::take(&mut self.host.rehearsed)
    }

    fn send_order(&mut self, sent: &Sent) {
        match sent {
            Sent::Guidance(order) => self.host.wires.send(&topics::GUIDANCE_ORDER, *order),
            Sent::Disturbance(order) => self.host.wires.send(&topics::DISTURBANCE_ORDER, *order),
        }
    }

    fn record_seating(&mut self, seating: &Seating, _config: Option<&Path>) {
        self.host.wires.show(&topics::SEATING, seating);
    }
}

/// How far those that fly have got.
pub(super) fn flying(loops: &[Loop]) -> Vec<InstanceMark> {
    loops.iter().filter(|l| l.flies()).map(Loop::mark).collect()
}
