//! Opens every port that a service declares.

use crate::executor::Executor;
use crate::graph::Graph;
use crate::input::{Input, InputVisitor, Source};
use crate::ipc::{Bus, PortError};
use crate::output::{Output, OutputVisitor};
use crate::process::{Ports, Timing};
use shared_types::{Sample, Seat, Topic, topics};

struct Readers<'a> {
    bus: &'a Bus,
    graph: &'a Graph,
    seat: Seat,
    timing: Option<&'a Timing>,
}

impl InputVisitor for Readers<'_> {
    type Error = PortError;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), PortError> {
        let edge = self.graph.edge_or_unwaited(&topic.info, self.seat.role);
        let port = self.bus.reader(topic, edge.from)?;
        let source: Box<dyn Source<T>> = match self.timing.and_then(|timing| timing.ports.as_ref())
        {
            Some(Ports { delays, collector }) => {
                delays.delay((self.seat, topic.info.name), collector.source(port))
            }
            None => Box::new(port),
        };
        input.connect(source, Some(edge));
        Ok(())
    }
}

struct Writers<'a> {
    bus: &'a Bus,
    graph: &'a Graph,
}

impl OutputVisitor for Writers<'_> {
    type Error = PortError;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), PortError> {
        let writer = self.bus.writer(topic)?;
        output.connect(Box::new(writer), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}

/// Opens every declared port, of a loop whose timing, and that of its samples, a script may set.
///
/// # Errors
/// The first port that cannot be had.
pub fn connect(
    bus: &Bus,
    graph: &Graph,
    executor: &mut Executor,
    timing: Option<&Timing>,
) -> Result<(), PortError> {
    let seat = Seat { role: executor.node().role, index: executor.place().seat };
    executor.component.visit_inputs(&mut Readers { bus, graph, seat, timing })?;
    executor.component.visit_outputs(&mut Writers { bus, graph })?;
    executor.stats.connect(Box::new(bus.writer(&topics::LOOP_STATS)?), 0);
    executor.deviations.connect(Box::new(bus.writer(&topics::DEVIATION)?), 0);
    Ok(())
}
