//! A flight in which slots change hands, in one process: the protocol of the launcher, with loops for
//! processes.
//!
//! [`Director`] gives `run/slots` its events and does what it wants done, at the instants at which the
//! launcher does it in lockstep: when everything that is allowed has been flown.

use super::loops::{Connect, Loop};
use super::marks::FlightMarks;
use super::wires::Wires;
use super::{InProcessError, Observer};
use crate::candidate::{Candidate, Slot};
use crate::components::{self, Crew};
use crate::orders::{Planner, Sent};
use crate::run::{
    ChildSpec, FlightError, Launch, Means, PostEvent, Posts, Script, Seen, SlotWatch, Slots,
    SwapReport,
};
use crate::scenario::Scenario;
use core::cell::RefCell;
use runtime::Graph;
use runtime::graph::CREDIT_NS;
use shared_types::{ClockMode, Handover, OwnerRecord, Role, Seat as Place, Seating, topics};
use slot::supervisor::Now;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// A seat of a slot, and who has had it.
#[derive(Debug)]
struct Post {
    name: &'static str,
    generation: u32,
    /// The last state published there, and by whom.
    last_state: Option<(u32, Vec<u8>)>,
}

/// What is needed to start loops in flight.
struct Cabin<O> {
    scenario: Scenario,
    wires: Wires<O>,
    watch: Rc<RefCell<SlotWatch>>,
    posts: BTreeMap<Place, Post>,
    events: Vec<PostEvent>,
    /// Those who are being started: a process opens its ports when all that happens at an instant has
    /// happened, and so who dies then has left nothing for it.
    starting: Vec<Place>,
}

/// Runs the script of a flight and the slots' state machines.
pub(super) struct Director<O> {
    slots: Slots,
    script: Script,
    /// What orders make of the flight's plan.
    pub(super) orders: Planner,
    cabin: Cabin<O>,
    /// Steps from here on have not been allowed \[ns\].
    pub(super) allowed_ns: u64,
    /// Everything before has been flown \[ns\].
    drained_ns: u64,
    /// What did not go as asked for.
    pub(super) notices: Vec<String>,
    /// Loops that had to be started again.
    pub(super) recovered: u64,
}

/// What of a script cannot be done within one process.
fn refuse_processes(scenario: &Scenario) -> Result<(), InProcessError> {
    let swaps = scenario.settings().swap.iter().map(|swap| (swap.slot, &swap.to));
    let standbys = scenario.settings().standby.iter().map(|s| (s.slot, &s.name));
    for (slot, name) in swaps.chain(standbys) {
        if !matches!(Candidate::find(slot, name), Ok(Candidate::Service(_))) {
            return Err(InProcessError::Foreign { name: name.clone() });
        }
    }
    for fault in &scenario.settings().fault {
        let role = components::role_of(&fault.name);
        if role.is_none_or(|role| role.seats() == 1) {
            return Err(InProcessError::NoSlot { name: fault.name.clone() });
        }
    }
    Ok(())
}

impl<O: Observer> Director<O> {
    /// Takes over the slots of a flight whose `loops` are ready and have not stepped.
    pub(super) fn new(
        scenario: &Scenario,
        graph: &Graph,
        wires: Wires<O>,
        watch: Rc<RefCell<SlotWatch>>,
        loops: &[Loop],
    ) -> Result<Self, InProcessError> {
        refuse_processes(scenario)?;
        let crew = Crew::of(scenario.settings());
        let (mut posts, mut events, mut specs) = (BTreeMap::new(), Vec::new(), Vec::new());
        for l in loops {
            let Some(name) = crew.name(l.node.role).filter(|_| l.place.role.seats() > 1) else {
                continue;
            };
            posts.insert(l.place, Post { name, generation: 0, last_state: None });
            events.push(l.joined());
            specs.push((l.node.role, spec(name)));
        }
        let settings = scenario.settings();
        Ok(Self {
            // Nobody is started here, so nobody is late.
            slots: Slots::new(ClockMode::Lockstep, &specs, scenario.modelled_vehicle(), u64::MAX),
            script: Script::new(settings, graph),
            orders: Planner::of(scenario).map_err(|error| InProcessError::Component {
                role: Role::Pilot.label(),
                error: error.to_string(),
            })?,
            cabin: Cabin {
                scenario: scenario.clone(),
                wires,
                watch,
                posts,
                events,
                starting: Vec::new(),
            },
            allowed_ns: 0,
            drained_ns: 0,
            notices: Vec::new(),
            recovered: 0,
        })
    }

    /// Once all that is allowed has been flown: does what is due, and allows more. False if there is
    /// no more.
    pub(super) fn go_on(
        &mut self,
        graph: &Graph,
        loops: &mut Vec<Loop>,
        marks: &mut FlightMarks,
        end_ns: u64,
    ) -> Result<bool, InProcessError> {
        let slowest_ns = loops.iter().filter(|l| l.flies()).map(|l| l.stepper.next_ns()).min();
        let slowest_ns = slowest_ns.unwrap_or(u64::MAX);
        if slowest_ns < self.allowed_ns.min(end_ns) {
            return Ok(false);
        }
        self.drained_ns = slowest_ns.max(self.drained_ns);
        if let FlightMarks::Seats(marks) = marks {
            for slot in Slot::ALL {
                marks.book(slot.role()).into_iter().for_each(|book| {
                    book.forget_before(self.drained_ns);
                });
            }
        }
        self.act(graph, loops, marks, end_ns, Slots::tend)?;
        loop {
            if self.script.next_ns() <= self.drained_ns {
                let mut script = core::mem::take(&mut self.script);
                let run = |slots: &mut Slots, means: &mut Means<'_>| script.run(slots, means);
                let done = self.act(graph, loops, marks, end_ns, run);
                self.script = script;
                done?;
            } else if !self.cabin.start_all(graph, loops, marks)? && self.cabin.events.is_empty() {
                break;
            }
            self.act(graph, loops, marks, end_ns, Slots::tend)?;
        }
        let cap_ns = self.slots.cap_ns(self.allowed_ns).min(self.script.next_ns()).min(end_ns);
        let before_ns = self.allowed_ns;
        self.allowed_ns = self.drained_ns.saturating_add(CREDIT_NS).min(cap_ns).max(before_ns);
        Ok(self.allowed_ns > before_ns)
    }

    fn act(
        &mut self,
        graph: &Graph,
        loops: &mut Vec<Loop>,
        marks: &mut FlightMarks,
        end_ns: u64,
        act: impl FnOnce(&mut Slots, &mut Means<'_>) -> Result<(), FlightError>,
    ) -> Result<(), InProcessError> {
        let recovered = &mut self.recovered;
        let mut seats = Seats { loops, marks, cabin: &mut self.cabin, recovered };
        let mut means = Means {
            posts: &mut seats,
            graph,
            orders: &mut self.orders,
            now: Now { logical_ns: self.drained_ns, allowed_ns: self.allowed_ns },
            now_mono_ns: 0,
            is_over: self.drained_ns >= end_ns,
        };
        let done = act(&mut self.slots, &mut means);
        for news in core::mem::take(&mut self.slots.news) {
            self.cabin.wires.observer().note(self.drained_ns, news.warning, &news.text);
            self.notices.extend(news.warning.then_some(news.text));
        }
        done.map_err(|error| InProcessError::Slots(error.to_string()))
    }

    /// Those whose seat is no longer theirs leave in order.
    pub(super) fn retire(&mut self, loops: &mut Vec<Loop>, marks: &mut FlightMarks) -> bool {
        let over = |l: &Loop| l.flies() && l.stepper.next_ns() >= l.leave_ns;
        let Some(at) = loops.iter().position(over) else { return false };
        let mut l = loops.remove(at);
        l.stepper.finish();
        self.cabin.bury(l, marks);
        true
    }

    /// What came of each swap; the flight is over.
    pub(super) fn reports(&mut self) -> Vec<SwapReport> {
        self.slots.finish();
        core::mem::take(&mut self.slots.reports)
    }
}

impl<O: Observer> Cabin<O> {
    /// Builds the loops of those who are being started; false if there are none.
    fn start_all(
        &mut self,
        graph: &Graph,
        loops: &mut Vec<Loop>,
        marks: &mut FlightMarks,
    ) -> Result<bool, InProcessError> {
        let starting = core::mem::take(&mut self.starting);
        for &place in &starting {
            let Some(Post { name, generation, .. }) = self.posts.get(&place) else { continue };
            let (name, generation) = (*name, *generation);
            let Some(node) = graph.node(place.role).copied() else { continue };
            let wires = &mut self.wires;
            let connect = Connect { graph, node, place, generation, wires, from: None };
            let built = components::build_service(Some(name), &self.scenario, connect);
            let l = built.map_err(|error| InProcessError::Component {
                role: place.role.label(),
                error: error.to_string(),
            })??;
            marks.seat(place, generation, true);
            self.events.push(l.joined());
            loops.push(Loop { waits: true, ..l });
        }
        Ok(!starting.is_empty())
    }

    /// A loop is gone: its last state stays, and nobody waits for it.
    fn bury(&mut self, mut l: Loop, marks: &mut FlightMarks) {
        marks.seat(l.place, l.generation, false);
        if let Some(post) = self.posts.get_mut(&l.place)
            && let Some(state) = l.stepper.state()
        {
            post.last_state = Some((l.generation, state));
        }
        self.events.push(PostEvent::Gone { place: l.place, obituary: None });
    }
}

/// How a service is started, which here is by its name alone.
fn spec(name: &str) -> ChildSpec {
    ChildSpec {
        name: name.to_owned(),
        executable: PathBuf::new(),
        launch: Launch::Service { config: None },
        cpu: None,
        nice: None,
        pause_ns: 0,
    }
}

/// Loops on seats.
struct Seats<'a, O> {
    loops: &'a mut Vec<Loop>,
    marks: &'a mut FlightMarks,
    cabin: &'a mut Cabin<O>,
    recovered: &'a mut u64,
}

impl<O: Observer> Seats<'_, O> {
    fn start(&mut self, place: Place, name: &'static str) {
        let cabin = &mut *self.cabin;
        let generation = cabin.posts.get(&place).map_or(0, |post| post.generation + 1);
        let last_state = cabin.posts.remove(&place).and_then(|post| post.last_state);
        cabin.posts.insert(place, Post { name, generation, last_state });
        cabin.starting.push(place);
    }

    fn at(&self, place: Place) -> Option<usize> {
        self.loops.iter().position(|l| l.place == place)
    }
}

impl<O: Observer> Posts for Seats<'_, O> {
    fn spawn(&mut self, place: Place, spec: ChildSpec) -> Result<(), FlightError> {
        let known = components::names_for(place.role).find(|name| *name == spec.name);
        if let Some(name) = known {
            self.start(place, name);
        }
        Ok(())
    }

    fn restart(&mut self, place: Place) -> Result<(), FlightError> {
        *self.recovered += 1;
        let name = self.cabin.posts.get(&place).map(|post| post.name);
        if let Some(name) = name {
            self.start(place, name);
        }
        Ok(())
    }

    fn announce(&mut self, record: OwnerRecord) {
        let role = record.slot;
        let attitude = role == Role::Attitude;
        let topic = if attitude { &topics::ATTITUDE_OWNER } else { &topics::POSITION_OWNER };
        self.cabin.wires.announce(topic, record);
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
        let Some(l) = self.at(place).and_then(|at| self.loops.get_mut(at)) else { return Ok(()) };
        let begun = l.stepper.begin(&order, state);
        l.waits = false;
        self.marks.advance(place, l.generation, l.stepper.next_ns());
        begun.map_err(|error| FlightError::NotReady {
            name: place.label(),
            how: error.to_string(),
            words: String::new(),
        })
    }

    fn last_state(&mut self, place: Place) -> Option<(u32, Vec<u8>)> {
        let at = self.at(place);
        let there = at.and_then(|at| {
            let l = &mut self.loops[at];
            Some((l.generation, l.stepper.state()?))
        });
        there.or_else(|| self.cabin.posts.get(&place)?.last_state.clone())
    }

    fn kill(&mut self, place: Place) {
        if let Some(at) = self.cabin.starting.iter().position(|starting| *starting == place) {
            self.cabin.starting.remove(at);
            self.cabin.events.push(PostEvent::Gone { place, obituary: None });
        } else if let Some(at) = self.at(place) {
            let l = self.loops.remove(at);
            self.cabin.bury(l, self.marks);
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

    fn seat_of(&self, name: &str) -> Option<Place> {
        self.cabin.posts.iter().find(|(_, post)| post.name == name).map(|(place, _)| *place)
    }

    fn generation(&self, place: Place) -> Option<u32> {
        self.cabin.posts.get(&place).map(|post| post.generation)
    }

    fn take_events(&mut self) -> Vec<PostEvent> {
        core::mem::take(&mut self.cabin.events)
    }

    fn take_seen(&mut self) -> Vec<Seen> {
        self.cabin.watch.borrow_mut().take()
    }

    fn send_order(&mut self, sent: &Sent) {
        match sent {
            Sent::Guidance(order) => self.cabin.wires.say(&topics::GUIDANCE_ORDER, *order),
            Sent::Disturbance(order) => self.cabin.wires.say(&topics::DISTURBANCE_ORDER, *order),
        }
    }

    fn tell_seating(&mut self, seating: &Seating, _config: Option<&Path>) {
        self.cabin.wires.observer().observe(&topics::SEATING, seating);
    }
}
