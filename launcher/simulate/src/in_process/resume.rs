//! A flight goes on from a checkpoint, and leaves one behind.

use super::checkpoint::{Checkpoint, Feed};
use super::observer::SampleTaps;
use super::tape::Tape;
use super::{InProcessError, Kernel, Outside, StateSource};
use replay::Course;
use runtime::graph::ROLES;
use scenario::Scenario;
use std::sync::Arc;

impl Kernel {
    /// Goes on from a checkpoint.
    pub(super) fn resume(
        scenario: &Scenario,
        taps: SampleTaps,
        checkpoint: &Checkpoint,
    ) -> Result<Self, InProcessError> {
        let from = (Some(checkpoint), &Outside::of(scenario.settings()));
        let mut flight = Self::build(scenario, StateSource::Estimator, taps, from)?;
        for l in &flight.loops {
            flight.marks.advance(l.place, l.generation, l.stepper.next_ns());
        }
        for index in 0..flight.loops.len() {
            let role = flight.loops[index].node.role;
            let mut feed = Feed {
                tape: &checkpoint.tape,
                graph: &flight.graph,
                marks: &flight.marks,
                role,
                at_ns: checkpoint.at_ns,
            };
            flight.loops[index].stepper.feed(&mut feed);
        }
        Ok(flight)
    }

    /// Goes through what happened to its loops before `t_ns`, as `tape` records it of each: releases left out
    /// or caught up and deadlines missed, which only a realtime flight has.
    pub fn repeat(&mut self, tape: &Tape, t_ns: u64) {
        for l in &mut self.loops {
            let generation = tape.generation_at(l.node.role, t_ns);
            l.course = Course::new(l.node.rate, tape.reported_by(l.node.role, generation, t_ns));
            l.course.prepare(&mut *l.stepper);
            self.marks.advance(l.place, l.generation, l.stepper.next_ns());
        }
    }

    /// The state of the whole flight at `at_ns`, up to which it has been flown; `tape` has
    /// everything that was published before.
    pub fn checkpoint(&mut self, tape: Arc<Tape>, at_ns: u64) -> Checkpoint {
        let (mut states, mut ports) = ([const { None }; ROLES], [None; ROLES]);
        for l in &mut self.loops {
            states[l.node.role.index()] = l.stepper.state();
            ports[l.node.role.index()] = Some(l.stepper.ports());
        }
        Checkpoint { tape, at_ns, states, exact: true, ports }
    }

    /// Draws everything random from the streams of another seed from now on.
    pub fn reseed(&mut self, seed: u64) {
        for l in &mut self.loops {
            l.stepper.reseed(seed);
        }
    }
}
