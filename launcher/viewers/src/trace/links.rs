//! The headers of a recording, where a chain looks for its next link.

use record::read::RecordVisitor;
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, Header, Sample, Topic, TopicInfo, topics,
};
use std::any::Any;

/// What a chain can consist of.
const TOPICS: [&TopicInfo; 6] = [
    &topics::IMU.info,
    &topics::STATE_ESTIMATE.info,
    &topics::WRENCH_COMMAND.info,
    &topics::APPLIED_COMMAND.info,
    &topics::APPLIED_SETPOINT.info,
    &topics::ATTITUDE_SETPOINT.info,
];

/// The first tick in which a command moved the rotors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tick {
    seat: u32,
    sequence: u64,
    header: Header,
}

/// Which set point an attitude loop went by in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Use {
    /// Seat of the loop, and instant of the step \[ns\].
    seat: u32,
    release_ns: u64,
    setpoint_seat: u32,
    setpoint_sequence: u64,
}

/// Every header that may be a link. Two of one sequence are two lives of a process.
#[derive(Debug, Default)]
pub(super) struct Links {
    commands: Vec<Header>,
    pub(super) end_ns: u64,
    imu: Vec<Header>,
    estimates: Vec<Header>,
    setpoints: Vec<Header>,
    uses: Vec<Use>,
    ticks: Vec<Tick>,
    in_effect: (u32, u64, u64),
}

impl RecordVisitor for Links {
    fn wants(&self, topic: &TopicInfo) -> bool {
        TOPICS.iter().any(|wanted| wanted.name == topic.name)
    }

    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let header = *sample.header();
        let any: &dyn Any = sample;
        if let Some(applied) = any.downcast_ref::<AppliedCommand>() {
            self.applied(applied);
        } else if let Some(applied) = any.downcast_ref::<AppliedSetpoint>() {
            self.uses.push(Use {
                seat: header.seat,
                release_ns: header.release_ns,
                setpoint_seat: applied.seat,
                setpoint_sequence: applied.setpoint_sequence,
            });
        } else if any.is::<AttitudeSetpoint>() {
            self.setpoints.push(header);
        } else if topic.info.name == topics::IMU.info.name {
            self.imu.push(header);
        } else if topic.info.name == topics::STATE_ESTIMATE.info.name {
            self.estimates.push(header);
        } else {
            self.commands.push(header);
        }
    }
}

impl Links {
    fn applied(&mut self, applied: &AppliedCommand) {
        let AppliedCommand { command_seat, command_sequence, command_cause_sequence, .. } =
            *applied;
        let in_effect = (command_seat, command_sequence, command_cause_sequence);
        if command_sequence > 0 && in_effect != self.in_effect {
            let header = applied.header;
            self.ticks.push(Tick { seat: command_seat, sequence: command_sequence, header });
        }
        self.in_effect = in_effect;
        self.end_ns = self.end_ns.max(applied.header.release_ns);
    }

    /// Commands released before an instant, in the order recorded; they are followed once.
    pub(super) fn take_commands(&mut self, until_ns: u64) -> Vec<Header> {
        self.commands.extract_if(.., |command| command.release_ns < until_ns).collect()
    }

    /// Lets go of what no later command descends from.
    pub(super) fn forget(&mut self, before_ns: u64) {
        for headers in [&mut self.imu, &mut self.estimates, &mut self.setpoints] {
            headers.retain(|header| header.release_ns >= before_ns);
        }
        self.uses.retain(|one| one.release_ns >= before_ns);
        self.ticks.retain(|tick| tick.header.release_ns >= before_ns);
    }

    /// To be called before anything is followed: a recorder takes topics in turn.
    pub(super) fn sort(&mut self) {
        for headers in [&mut self.imu, &mut self.estimates] {
            headers.sort_by_key(|h| (h.sequence, h.publish_mono_ns));
        }
        self.setpoints.sort_by_key(|h| (h.seat, h.sequence, h.publish_mono_ns));
        self.uses.sort_by_key(|u| (u.seat, u.release_ns));
        self.ticks.sort_by_key(|t| (t.seat, t.sequence, t.header.release_ns));
    }

    pub(super) fn imu(&self, sequence: u64) -> Option<&Header> {
        of_key(&self.imu, &sequence, |h| h.sequence).next_back()
    }

    /// The estimate that a step went by. Of two lives' the later one, if it was there in time.
    pub(super) fn estimate(&self, user: &Header) -> Option<&Header> {
        let mut same = of_key(&self.estimates, &user.input_sequence, |h| h.sequence);
        same.rfind(|estimate| was_there(estimate, user))
    }

    /// The set point that a command's step went by.
    pub(super) fn setpoint(&self, command: &Header) -> Option<&Header> {
        let key = (command.seat, command.release_ns);
        let mut step = of_key(&self.uses, &key, |u| (u.seat, u.release_ns));
        let Use { setpoint_seat, setpoint_sequence, .. } = *step.next_back()?;
        let key = (setpoint_seat, setpoint_sequence);
        let mut same = of_key(&self.setpoints, &key, |h| (h.seat, h.sequence));
        same.rfind(|setpoint| was_there(setpoint, command))
    }

    /// The first tick of the plant that reports the command as in effect.
    pub(super) fn tick(&self, command: &Header) -> Option<&Header> {
        let key = (command.seat, command.sequence);
        let mut same = of_key(&self.ticks, &key, |t| (t.seat, t.sequence)).map(|tick| &tick.header);
        same.find(|tick| tick.release_ns >= command.valid_ns)
    }
}

/// Entries with a key, of a list in its order.
fn of_key<'a, T, K: Ord>(
    list: &'a [T],
    key: &K,
    of: impl Fn(&T) -> K,
) -> impl DoubleEndedIterator<Item = &'a T> {
    let from = list.partition_point(|item| of(item) < *key);
    let to = list.partition_point(|item| of(item) <= *key);
    list[from..to].iter()
}

/// True if a step can have gone by a sample.
fn was_there(sample: &Header, user: &Header) -> bool {
    sample.valid_ns <= user.release_ns && sample.publish_mono_ns <= user.start_mono_ns
}
