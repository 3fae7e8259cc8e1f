//! Opens every port that a service declares.

use crate::executor::Executor;
use crate::graph::{Edge, Graph};
use crate::input::{Input, InputSet as _, InputVisitor};
use crate::ipc::{Bus, PortError};
use crate::output::{Output, OutputSet as _, OutputVisitor};
use crate::service::Service;
use shared_types::{Author, Role, Sample, Topic, topics};

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
        input.connect(Box::new(self.bus.reader(topic)?), Some(edge));
        Ok(())
    }
}

struct Writers<'a> {
    bus: &'a Bus,
    graph: &'a Graph,
    command_author: Author,
}

impl OutputVisitor for Writers<'_> {
    type Error = PortError;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), PortError> {
        let writer = self.bus.writer(topic)?;
        if is_slot_command(topic.info.name) {
            self.command_author = writer.author();
        }
        output.connect(Box::new(writer), self.graph.latency_ns(&topic.info));
        Ok(())
    }
}

/// True for the topics whose writer must own a slot.
fn is_slot_command(name: &str) -> bool {
    name == topics::WRENCH_COMMAND.info.name || name == topics::ATTITUDE_SETPOINT.info.name
}

/// Opens every declared port and returns the identity under which slot commands will appear
/// (zeros if the service writes none).
///
/// # Errors
/// The first port that cannot be had.
pub fn connect<S: Service>(
    bus: &Bus,
    graph: &Graph,
    executor: &mut Executor<S>,
) -> Result<Author, PortError> {
    let role = executor.node().role;
    executor.inputs.visit(&mut Readers { bus, graph, role })?;
    let mut writers = Writers { bus, graph, command_author: Author::default() };
    executor.outputs.visit(&mut writers)?;
    executor.stats.connect(Box::new(bus.writer(&topics::LOOP_STATS)?), 0);
    executor.deviations.connect(Box::new(bus.writer(&topics::DEVIATION)?), 0);
    Ok(writers.command_author)
}
