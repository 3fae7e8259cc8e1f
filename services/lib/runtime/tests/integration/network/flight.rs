//! Flights of the whole network: in textbook order, and in any order a scheduler may choose.

use super::seat::{Seat, Worker};
use super::toys;
use super::transport::{Log, Network};
use runtime::graph::{CREDIT_NS, ROLES};
use runtime::{Graph, InputCounts, Node, SeatMarks};
use shared_types::{Progress, Role};

/// A flight to fly.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) graph: Graph,
    pub(crate) end_ns: u64,
    pub(crate) state_every: u64,
}

/// What became of it.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) log: Log,
    pub(crate) counts: InputCounts,
    /// Reasons why the flight is not as it should be.
    pub(crate) faults: Vec<String>,
}

/// A process to be killed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kill {
    pub(crate) role: Role,
    /// Killed at some action after it has stepped up to this instant.
    pub(crate) at_ns: u64,
}

fn seats(plan: &Plan, network: &Network) -> Vec<Box<dyn Seat>> {
    let graph = &plan.graph;
    let rig = graph.node(Role::Position).is_none();
    let seat = |node: &Node| -> Box<dyn Seat> {
        let (node, every) = (*node, plan.state_every);
        match node.role {
            Role::Plant => Box::new(Worker::new::<toys::plant::Toy>(graph, node, network, every)),
            Role::Estimator => {
                Box::new(Worker::new::<toys::estimator::Toy>(graph, node, network, every))
            }
            Role::Position => {
                Box::new(Worker::new::<toys::position::Toy>(graph, node, network, every))
            }
            Role::Attitude => {
                Box::new(Worker::new::<toys::attitude::Toy>(graph, node, network, every))
            }
            Role::Disturbance => {
                Box::new(Worker::new::<toys::disturbance::Toy>(graph, node, network, every))
            }
            Role::Monitor => {
                Box::new(Worker::new::<toys::monitor::Toy>(graph, node, network, every))
            }
            _ if rig => Box::new(Worker::new::<toys::rig_pilot::Toy>(graph, node, network, every)),
            _ => Box::new(Worker::new::<toys::pilot::Toy>(graph, node, network, every)),
        }
    };
    graph.nodes().iter().map(seat).collect()
}

fn outcome(seats: Vec<Box<dyn Seat>>, network: &Network, faults: Vec<String>) -> Outcome {
    let counts = seats.iter().fold(InputCounts::default(), |sum, seat| sum + seat.counts());
    drop(seats);
    let log = core::mem::take(&mut *network.log.borrow_mut());
    Outcome { log, counts, faults }
}

/// Flies in global order of time, one release after the other, the plant first and then along the
/// undelayed arrows. Knows nothing of marks, permissions and wake-ups.
pub(crate) fn fly_in_textbook_order(plan: &Plan) -> Outcome {
    let network = Network::default();
    let mut seats = seats(plan, &network);
    loop {
        let t_ns = seats.iter().map(|s| s.mark_ns()).min().unwrap_or(u64::MAX);
        if t_ns >= plan.end_ns {
            break;
        }
        let due: Vec<Role> =
            seats.iter().filter(|s| s.mark_ns() == t_ns).map(|s| s.node().role).collect();
        let first = due.iter().copied().find(|&role| {
            role == Role::Plant
                || plan.graph.edges().iter().all(|e| {
                    e.to != role || e.latency_ns > 0 || e.from == role || !due.contains(&e.from)
                })
        });
        let Some(first) = first else {
            return outcome(seats, &network, vec![format!("no role can be first of {due:?}")]);
        };
        for seat in seats.iter_mut().filter(|s| s.node().role == first) {
            seat.receive();
            seat.step();
            seat.flush();
        }
    }
    outcome(seats, &network, Vec::new())
}

/// What a process does next; the order of the loop in `process.rs`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Look,
    Receive,
    Run,
    Announce,
    Asleep,
    Finished,
}

struct Actor {
    seat: Box<dyn Seat>,
    phase: Phase,
    woken: bool,
    marks: SeatMarks,
    clock_ns: u64,
    before_ns: u64,
}

/// Random numbers for the scheduler.
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn below(&mut self, n: u64) -> u64 {
        self.0 = toys::mix(self.0, 1);
        self.0 % n
    }
}

struct Scheduler<'a> {
    plan: &'a Plan,
    actors: Vec<Actor>,
    announced: [Progress; ROLES],
    allowed_ns: u64,
    dice: Dice,
    starved: usize,
    faults: Vec<String>,
}

/// Flies with the rules of `process.rs` in an order drawn from `seed`: which loop acts next, how much of
/// what is sent is seen before the mark, how far allowed time reaches. A process acts only when it
/// has been woken by [`Graph::lockstep_wakes`], by an extension of allowed time or at its start.
pub(crate) fn fly_in_random_order(plan: &Plan, seed: u64, kills: &[Kill]) -> Outcome {
    let network = Network::default();
    let actors = seats(plan, &network)
        .into_iter()
        .map(|seat| Actor {
            seat,
            phase: Phase::Look,
            woken: false,
            marks: SeatMarks::default(),
            clock_ns: 0,
            before_ns: 0,
        })
        .collect();
    let mut scheduler = Scheduler {
        plan,
        actors,
        announced: [Progress::default(); ROLES],
        allowed_ns: 1,
        starved: usize::try_from(Dice(seed ^ 0x51).below(ROLES as u64 + 2)).unwrap_or(ROLES),
        dice: Dice(seed),
        faults: Vec::new(),
    };
    scheduler.fly(kills);
    let Scheduler { actors, faults, .. } = scheduler;
    outcome(actors.into_iter().map(|a| a.seat).collect(), &network, faults)
}

impl Scheduler<'_> {
    fn fly(&mut self, kills: &[Kill]) {
        let mut kills = kills.to_vec();
        while self.faults.is_empty() {
            self.kill_some(&mut kills);
            let ready = self.ready();
            if ready.is_empty() {
                if self.actors.iter().all(|a| a.phase == Phase::Finished) {
                    return;
                }
                self.refuse_standstill();
                self.extend();
                continue;
            }
            match self.dice.below(64) {
                0 => self.extend(),
                1..8 => self.deliver_some(),
                _ => {
                    let chosen = self.dice.below(ready.len() as u64);
                    // Now and then one process runs for long while the others stand.
                    for _ in 0..=self.dice.below(12) {
                        self.act(ready[usize::try_from(chosen).unwrap_or(0)]);
                        self.kill_some(&mut kills);
                    }
                }
            }
        }
    }

    /// The processes that may act. One process of most flights starves: it gets its turn when no other wants
    /// one, so that the others run as far ahead as they ever can.
    fn ready(&self) -> Vec<usize> {
        let mut ready: Vec<usize> = (0..self.actors.len())
            .filter(|&i| !matches!(self.actors[i].phase, Phase::Asleep | Phase::Finished))
            .collect();
        if ready.len() > 1 {
            ready.retain(|&i| i != self.starved);
        }
        ready
    }

    fn kill_some(&mut self, kills: &mut Vec<Kill>) {
        let due = |k: &Kill| {
            let actor = self.actors.iter().find(|a| a.seat.node().role == k.role);
            actor.is_some_and(|a| a.seat.mark_ns() > k.at_ns)
        };
        if let Some(at) = kills.iter().position(due)
            && self.dice.below(4) == 0
        {
            let kill = kills.swap_remove(at);
            self.kill(kill.role);
        }
    }

    fn act(&mut self, index: usize) {
        let graph = &self.plan.graph;
        let actor = &mut self.actors[index];
        let node = actor.seat.node();
        match actor.phase {
            Phase::Look => {
                actor.clock_ns = self.allowed_ns;
                for from in graph.nodes() {
                    let progress = &self.announced[from.role.index()];
                    actor.marks.update(shared_types::Seat::first(from.role), progress, 0);
                }
                actor.phase = Phase::Receive;
            }
            Phase::Receive => {
                actor.seat.receive();
                actor.before_ns = actor.seat.mark_ns();
                actor.phase = Phase::Run;
            }
            Phase::Run => {
                let mark_ns = actor.seat.mark_ns();
                if mark_ns < self.plan.end_ns
                    && graph.runnable(&node, mark_ns, &actor.marks, actor.clock_ns)
                {
                    actor.seat.step();
                } else if mark_ns >= self.plan.end_ns || mark_ns > actor.before_ns {
                    actor.phase = Phase::Announce;
                } else if core::mem::take(&mut actor.woken) {
                    actor.phase = Phase::Look;
                } else {
                    actor.phase = Phase::Asleep;
                }
            }
            Phase::Announce => self.announce(index),
            Phase::Asleep | Phase::Finished => {}
        }
    }

    fn announce(&mut self, index: usize) {
        let actor = &mut self.actors[index];
        let role = actor.seat.node().role;
        let mark_ns = actor.seat.mark_ns();
        let (before_ns, after_ns) = if mark_ns >= self.plan.end_ns {
            actor.phase = Phase::Finished;
            (mark_ns, u64::MAX)
        } else {
            actor.phase = Phase::Look;
            (actor.before_ns, mark_ns)
        };
        actor.seat.flush();
        let graph = &self.plan.graph;
        let known_ns = actor
            .clock_ns
            .min(self.plan.end_ns)
            .min(mark_ns.saturating_add(graph.quiet_limit_ns(role)));
        self.announced[role.index()] = Progress {
            mark_ns: after_ns.max(self.announced[role.index()].mark_ns),
            quiet_until_ns: actor.seat.quiet_until_ns(known_ns),
            ..Progress::default()
        };
        // With what it knew of the others before.
        let woken_from_ns = |node: &Node| match graph.quiet_limit_ns(node.role) {
            0 => 0,
            _ => actor.marks.woken_from_ns(node),
        };
        let woken: Vec<Role> =
            graph.lockstep_wakes(role, before_ns, after_ns, woken_from_ns).collect();
        self.wake(|r| woken.contains(&r) && self.plan.graph.waits_for(r, role));
    }

    fn wake(&mut self, is_woken: impl Fn(Role) -> bool) {
        for actor in self.actors.iter_mut().filter(|a| is_woken(a.seat.node().role)) {
            if actor.phase == Phase::Asleep {
                actor.phase = Phase::Look;
            } else {
                actor.woken = true;
            }
        }
    }

    fn slowest_ns(&self) -> u64 {
        self.actors
            .iter()
            .map(|a| self.announced[a.seat.node().role.index()].mark_ns)
            .min()
            .unwrap_or(0)
    }

    /// All processes sleep: then each must have used up the allowed time.
    fn refuse_standstill(&mut self) {
        let limit_ns = self.allowed_ns.min(self.plan.end_ns);
        for actor in &self.actors {
            let mark_ns = actor.seat.mark_ns();
            if actor.phase == Phase::Asleep && mark_ns < limit_ns {
                self.faults.push(format!(
                    "{:?} sleeps at {mark_ns} although {limit_ns} is allowed, marks {:?}",
                    actor.seat.node().role,
                    self.announced,
                ));
            }
        }
    }

    fn extend(&mut self) {
        let ahead_ns = 1 + self.dice.below(CREDIT_NS);
        let allowed_ns = self.slowest_ns().saturating_add(ahead_ns);
        if allowed_ns > self.allowed_ns {
            self.allowed_ns = allowed_ns;
            self.wake(|_| true);
        }
    }

    fn deliver_some(&mut self) {
        for actor in &self.actors {
            let unseen = actor.seat.unseen() as u64;
            let count = self.dice.below(unseen + 1);
            actor.seat.deliver(usize::try_from(count).unwrap_or(0));
        }
    }

    fn kill(&mut self, role: Role) {
        let graph = &self.plan.graph;
        let Some(actor) = self.actors.iter_mut().find(|a| a.seat.node().role == role) else {
            return;
        };
        if actor.phase == Phase::Finished {
            return;
        }
        let survivors = self.dice.below(actor.seat.unseen() as u64 + 1);
        actor.seat.restart(usize::try_from(survivors).unwrap_or(0));
        actor.phase = Phase::Look;
        actor.marks = SeatMarks::default();
        let mark_ns = &mut self.announced[role.index()].mark_ns;
        *mark_ns = actor.seat.mark_ns().max(*mark_ns);
        self.wake(|r| graph.waits_for(r, role));
    }
}

impl Outcome {
    /// Differences from an undisturbed flight and everything that should never happen.
    pub(crate) fn complaints(&self, expected: &Outcome) -> Vec<String> {
        let mut complaints = self.faults.clone();
        complaints.extend(self.log.contradictions.iter().cloned());
        if self.counts != InputCounts::default() || self.log.overflowed > 0 {
            complaints.push(format!("{:?}, {} dropped", self.counts, self.log.overflowed));
        }
        for (topic, stream) in &expected.log.streams {
            let ours = self.log.streams.get(topic).map_or(&[][..], Vec::as_slice);
            if ours != stream.as_slice() {
                let at = ours.iter().zip(stream).take_while(|(a, b)| a == b).count();
                let (n, m) = (ours.len(), stream.len());
                complaints.push(format!("{topic} differs from #{} on ({n} of {m})", at + 1));
            }
        }
        if self.log.stats != expected.log.stats {
            complaints.push("loop statistics differ".to_owned());
        }
        complaints
    }
}
