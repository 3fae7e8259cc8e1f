//! Opens every port that a service declares.

use crate::executor::Executor;
use crate::graph::{Edge, Graph};
use crate::input::{Input, InputVisitor};
use crate::ipc::{Bus, PortError};
use crate::output::{Output, OutputVisitor};
use shared_types::{Role, Sample, Topic, topics};

struct Readers<'a> {
    bus: &'a Bus,
    graph: &'a Graph,
    role: Role,
}

impl InputVisitor for Readers<'_> {
    type Error = PortError;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), PortError> {
        let edge = self.graph.edge(&topic.info, self.role).copied();
        let edge = edge.unwrap_or_else(|| Edge::unwaited(&topic.info, self.role));
        input.connect(Box::new(self.bus.reader(topic, edge.from)?), Some(edge));
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

/// Opens every declared port.
///
/// # Errors
/// The first port that cannot be had.
pub fn connect(bus: &Bus, graph: &Graph, executor: &mut Executor) -> Result<(), PortError> {
    let role = executor.node().role;
    executor.component.visit_inputs(&mut Readers { bus, graph, role })?;
    executor.component.visit_outputs(&mut Writers { bus, graph })?;
    executor.stats.connect(Box::new(bus.writer(&topics::LOOP_STATS)?), 0);
    executor.deviations.connect(Box::new(bus.writer(&topics::DEVIATION)?), 0);
    Ok(())
}
