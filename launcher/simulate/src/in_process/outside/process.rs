//! A process as a loop of the flight: started, given where to begin, stepped, and ended.

use super::super::checkpoint::Feed as Resumed;
use super::super::stepper::{InstanceMark, StepContext, Stepper};
use super::super::wires::Wires;
use super::feeds::{self, Feed};
use super::namespace::{Namespace, OutsideError};
use super::outputs::Outputs;
use super::{ExitReport, Outside};
use core::time::Duration;
use replay::Repeats;
use runtime::Graph;
use runtime::clock::mono_now_ns;
use runtime::ipc::{IpcSource, LatestPort, PortError, ServiceKind, WakeListener, WakeNotifier};
use runtime::service::RestoreError;
use scenario::Scenario;
use shared_types::{Deviation, Handover, Hello, Progress, Seat};
use swap::Standstill;
use swap::child::{ChildSpec, RunningChild, describe};
use swap::post::Post;
use swap::services::stand_in;

/// Wait for a process until it is looked at whether or not it has woken another one.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// The same while it opens its ports, for which it wakes no other one.
const LOOK_EVERY_AT_START: Duration = Duration::from_millis(1);

/// How a process ends that leaves in order.
const LEFT: &str = "exit status 0";

/// What a process is started from.
#[derive(Debug, Clone, Copy)]
pub(in crate::in_process) struct Start<'a> {
    pub(in crate::in_process) scenario: &'a Scenario,
    pub(in crate::in_process) graph: &'a Graph,
    pub(in crate::in_process) outside: &'a Outside,
    pub(in crate::in_process) spec: &'a ChildSpec,
    pub(in crate::in_process) place: Seat,
    pub(in crate::in_process) generation: u32,
}

/// A process in a namespace of its own.
pub(in crate::in_process) struct OutsideLoop {
    /// Dropped first, which ends the process.
    post: Post,
    feeds: Vec<Box<dyn Feed>>,
    outputs: Outputs,
    hello: IpcSource<Hello>,
    progress: LatestPort<Progress>,
    wakes: WakeNotifier,
    woken: WakeListener,
    outside: Outside,
    layout: u64,
    period_ns: u64,
    /// Its next release, as it reports \[ns\].
    next_ns: u64,
    failure: Option<ExitReport>,
    namespace: Namespace,
}

impl OutsideLoop {
    /// Starts a process, which will send its hello.
    pub(in crate::in_process) fn start(
        start: Start<'_>,
        wires: &mut Wires,
    ) -> Result<Self, String> {
        Self::try_start(start, wires).map_err(|error| error.to_string())
    }

    fn try_start(start: Start<'_>, wires: &mut Wires) -> Result<Self, OutsideError> {
        let Start { scenario, graph, outside, spec, place, generation } = start;
        let namespace = Namespace::found(scenario, graph, place)?;
        let bus = namespace.bus();
        let hello = bus.open_service::<Hello>(ServiceKind::Hello)?;
        let mut new = Self {
            post: Post::open(bus, place, spec.clone())?,
            feeds: feeds::open(wires, graph, place),
            outputs: Outputs::open(wires, bus, graph, place)?,
            hello: IpcSource::with_capacity(&hello, 4)?,
            progress: LatestPort::progress(bus, place)?,
            wakes: WakeNotifier::open(bus, place)?,
            woken: WakeListener::open(bus, stand_in(graph, place.role))?,
            outside: outside.clone(),
            layout: 0,
            period_ns: 0,
            next_ns: 0,
            failure: None,
            namespace,
        };
        new.post.generation = generation;
        let started = new.post.start(new.namespace.folder(), true);
        // It has failed then, as one that ends at once.
        new.check(started.map_err(|error| format!("cannot be started: {error}")));
        Ok(new)
    }

    /// Waits until all ports of the process are open; false if they never will be.
    pub(in crate::in_process) fn await_ready(&mut self) -> bool {
        if self.failure.is_some() {
            return false;
        }
        let limit = self.outside.startup_limit;
        let ready = self.wait(limit, LOOK_EVERY_AT_START, Self::take_hello);
        self.check(ready.map_err(|stop| match stop {
            Stop::Exited(how) => format!("ended before it was ready ({how})"),
            Stop::Hung(s) => format!("was not ready within {s} s, and was killed"),
            Stop::Port(error) => error.to_string(),
        }))
    }

    /// Period that the process has \[ns\].
    pub(in crate::in_process) fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// Lets the process begin where a hand-over states, in a flight whose loops have got so far; false if
    /// it does not.
    fn hand_over(&mut self, order: Handover, state: &[u8], instances: &[InstanceMark]) -> bool {
        let fed = self.feed(instances, 0);
        self.post.hand_over(order, state);
        let begun = fed.map_err(Stop::Port).and_then(|()| {
            self.wakes.wake();
            let limit = self.outside.startup_limit;
            self.wait(limit, LOOK_EVERY_AT_START, |this| {
                this.post.serve_late_joiners();
                this.namespace.serve_late_joiners();
                this.feeds.iter_mut().for_each(|feed| feed.serve_late_joiners());
                this.has_moved(None)
            })
        });
        self.outputs.gather();
        self.check(begun.map_err(|stop| match stop {
            Stop::Exited(how) => format!("ended at its hand-over ({how})"),
            Stop::Hung(s) => format!("did not begin within {s} s, and was killed"),
            Stop::Port(error) => error.to_string(),
        }))
    }

    /// Shows the process everything that has been published, then how far every loop has got.
    fn feed(&mut self, instances: &[InstanceMark], allowed_ns: u64) -> Result<(), PortError> {
        let namespace = &mut self.namespace;
        self.feeds.iter_mut().try_for_each(|feed| feed.pump(namespace))?;
        namespace.publish_marks(instances)?;
        namespace.allow(allowed_ns);
        Ok(())
    }

    /// Takes in the hello of the process that was started, and of no other.
    fn take_hello(&mut self) -> bool {
        while let Some((hello, node, pid)) = self.hello.receive_from() {
            let Some(hello) = hello else { continue };
            let sender = (Seat { role: hello.role, index: hello.seat }, hello.generation);
            let seat = self.post.seat;
            if sender == (seat, self.post.generation) && self.post.is_controller(pid) {
                (self.layout, self.period_ns) = (hello.state_layout, hello.period_ns);
                self.namespace.enter(node, seat, hello.generation, hello.period_ns);
                return true;
            }
        }
        false
    }

    /// True once the process has got beyond an instant, or has begun.
    fn has_moved(&mut self, beyond_ns: Option<u64>) -> bool {
        let (generation, next_ns) = (self.post.generation, &mut self.next_ns);
        let mut moved = false;
        self.progress.for_each_new(|progress| {
            if progress.generation == generation {
                *next_ns = progress.mark_ns;
                moved |= beyond_ns.is_none_or(|beyond_ns| progress.mark_ns > beyond_ns);
            }
        });
        moved
    }

    /// Waits until the process has done something, unless it ends or hangs.
    fn wait(
        &mut self,
        limit: Duration,
        look_every: Duration,
        mut is_done: impl FnMut(&mut Self) -> bool,
    ) -> Result<(), Stop> {
        let mut patience_ns = None;
        let mut standstill = None;
        loop {
            if is_done(self) {
                return Ok(());
            }
            if self.woken.wait(look_every) {
                continue;
            }
            if let Some(how) = self.exited() {
                // What it published before it went counts.
                return if is_done(self) { Ok(()) } else { Err(Stop::Exited(how)) };
            }
            let now_ns = mono_now_ns();
            let until_ns = *patience_ns.get_or_insert_with(|| {
                now_ns.saturating_add(u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX))
            });
            if now_ns >= until_ns && self.hangs(&mut standstill) {
                return Err(Stop::Hung(limit.as_secs_f64()));
            }
            if look_every == LOOK_EVERY {
                // A wake-up may have been lost.
                self.wakes.wake();
            }
        }
    }

    fn exited(&mut self) -> Option<String> {
        self.post.child.as_mut().and_then(RunningChild::exited).map(describe)
    }

    /// True if the process stands still although it could run.
    fn hangs(&self, standstill: &mut Option<Standstill>) -> bool {
        let pid = self.post.child.as_ref().map(RunningChild::pid);
        pid.is_none_or(|pid| Standstill::is_hang(standstill, pid, self.next_ns))
    }

    /// Keeps what has become of a process that does not go on, and ends it.
    fn check(&mut self, done: Result<(), String>) -> bool {
        let Err(how) = done else { return true };
        let mut last_stderr = String::new();
        if let Some(mut child) = self.post.child.take() {
            child.kill();
            last_stderr = child.last_stderr();
        }
        let (name, at_ns) = (self.post.spec.name.clone(), self.next_ns);
        self.failure = Some(ExitReport { name, at_ns, how, last_stderr });
        false
    }

    /// Lets the process publish its last samples, and waits until it has gone.
    fn leave(&mut self) -> Result<(), Stop> {
        let limit = self.outside.startup_limit;
        self.namespace.end(self.next_ns);
        self.wakes.wake();
        self.wait(limit, LOOK_EVERY, |this| this.has_moved(Some(u64::MAX - 1)))?;
        self.namespace.let_leave();
        self.wakes.wake();
        self.wait(limit, LOOK_EVERY_AT_START, |_| false)
    }
}

impl Repeats for OutsideLoop {
    fn next_ns(&self) -> u64 {
        self.next_ns
    }
    /// What lockstep leaves out does not have to be left out again.
    fn repeat(&mut self, _deviation: &Deviation) {}
}

impl Stepper for OutsideLoop {
    fn is_outside(&self) -> bool {
        true
    }

    fn has_failed(&self) -> bool {
        self.failure.is_some()
    }

    fn take_failure(&mut self) -> Option<ExitReport> {
        self.failure.take()
    }

    fn begin(
        &mut self,
        order: &Handover,
        state: &[u8],
        instances: &[InstanceMark],
    ) -> Result<(), RestoreError> {
        self.hand_over(*order, state, instances);
        Ok(())
    }

    fn layout(&self) -> u64 {
        self.layout
    }

    fn step(&mut self, context: &StepContext<'_>) -> bool {
        let before_ns = self.next_ns;
        let fed = self.feed(context.instances, context.allowed_ns).map_err(Stop::Port);
        let stepped = fed.and_then(|()| {
            self.wakes.wake();
            let limit = self.outside.step_limit;
            self.wait(limit, LOOK_EVERY, |this| this.has_moved(Some(before_ns)))
        });
        self.outputs.gather();
        self.check(stepped.map_err(|stop| match stop {
            Stop::Exited(how) if how == LEFT => format!("left in the middle of the flight ({how})"),
            Stop::Exited(how) => how,
            Stop::Hung(s) => {
                format!("made no progress for {s} s although it could, and was killed")
            }
            Stop::Port(error) => error.to_string(),
        }))
    }

    fn finish(&mut self) {
        let mark_ns = self.next_ns;
        // It is to see why it leaves.
        let namespace = &mut self.namespace;
        let fed = self.feeds.iter_mut().try_for_each(|feed| feed.pump(namespace));
        let left = fed.map_err(Stop::Port).and_then(|()| self.leave());
        self.next_ns = mark_ns;
        self.outputs.gather();
        self.check(match left {
            Ok(()) => Ok(()),
            Err(Stop::Exited(how)) if how == LEFT => Ok(()),
            Err(Stop::Exited(how)) => Err(how),
            Err(Stop::Hung(s)) => Err(format!("did not leave within {s} s, and was killed")),
            Err(Stop::Port(error)) => Err(error.to_string()),
        });
    }

    fn state(&mut self) -> Option<Vec<u8>> {
        self.outputs.state()
    }

    /// A state of it fits its own kind alone.
    fn ports(&self) -> u64 {
        0
    }

    fn reseed(&mut self, _seed: u64) {}

    /// No flight that is taken up in the middle begins with it.
    fn feed(&mut self, _feed: &mut Resumed<'_>) {}
}

/// Why a process is no longer waited for.
enum Stop {
    /// It has ended.
    Exited(String),
    /// It did nothing for so long \[s\].
    Hung(f64),
    /// It could not be sent what to do.
    Port(PortError),
}
