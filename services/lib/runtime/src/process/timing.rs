//! The time that a script has a process take: on a clock that the launcher moves, or by the wall clock.

use crate::clock::WallMap;
use crate::collector::Collector;
use crate::delays::Delays;
use crate::timed::START_MONO_NS;
use shared_types::Role;
use std::rc::Rc;
use timing::{LoopName, Script};

/// What happens to the time of a process's loop and of the samples that it reads.
#[derive(Debug)]
pub struct Timing {
    pub(super) script: Rc<Script>,
    pub(super) name: String,
    /// None by the wall clock.
    pub(crate) ports: Option<Ports>,
}

/// How samples come to a loop whose clock the launcher moves.
#[derive(Debug, Clone)]
pub(crate) struct Ports {
    /// When samples arrive.
    pub(crate) delays: Rc<Delays>,
    /// What has come to the ports.
    pub(crate) collector: Rc<Collector>,
}

impl Timing {
    /// Of a flight's script, for the process of the service `name`: on a clock that the launcher moves, or by the wall
    /// clock, by which the loop waits as long as its steps are to take.
    #[must_use]
    pub fn new(script: Script, name: &str, by_the_wall: bool) -> Self {
        let name = name.to_owned();
        if by_the_wall {
            return Self { script: Rc::new(script), name, ports: None };
        }
        let script = Rc::new(script.on_clock(START_MONO_NS));
        let delays = Rc::new(Delays::new(Rc::clone(&script)));
        Self { script, name, ports: Some(Ports { delays, collector: Rc::default() }) }
    }

    /// By the wall clock: when a step begins that may begin at an instant \[ns\], for a release.
    pub(super) fn begins_mono_ns(&self, role: Role, wall: WallMap, at: (u64, u64)) -> u64 {
        later(wall, at, |at_ns, release_ns| {
            self.script.begins_ns(self.loop_name(role), at_ns, release_ns)
        })
    }

    /// By the wall clock: when a step is over that began at an instant \[ns\], for a release.
    pub(super) fn ends_mono_ns(&self, role: Role, wall: WallMap, at: (u64, u64)) -> u64 {
        later(wall, at, |at_ns, release_ns| {
            self.script.ends_ns(self.loop_name(role), at_ns, release_ns)
        })
    }

    fn loop_name(&self, role: Role) -> LoopName<'_> {
        LoopName { role, name: &self.name }
    }
}

/// An instant that the script puts off by logical time, put off as long by the wall clock.
fn later(wall: WallMap, at: (u64, u64), put_off: impl Fn(u64, u64) -> u64) -> u64 {
    let (at_mono_ns, release_ns) = at;
    let at_ns = wall.logical_ns(at_mono_ns);
    let by_ns = put_off(at_ns, release_ns).saturating_sub(at_ns);
    at_mono_ns.saturating_add(wall.mono_ns(by_ns).saturating_sub(wall.mono_ns(0)))
}
