//! From the IMU sample to the command at the plant's gate, link by link.

use super::Window;
use super::steps::{by_sequence, find};
use crate::series::Series;
use observe::stopwatch::{Stamp, Stopwatch};
use shared_types::topics;
use std::collections::BTreeMap;

/// From publication of a set point to the step of the attitude loop that uses it: its latency, and what is
/// left of that loop's period.
pub const SETPOINT_HOLD: &str = "hold of the set point";

/// A stretch of the way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Link {
    /// What takes the time.
    pub name: &'static str,
    /// How long it took \[ns\].
    pub ns: u64,
}

/// One command's way from the sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    /// Logical instant of the sample that began it \[ns\].
    pub release_ns: u64,
    /// Stretches, in order; the first begins at the intended release of the plant's step.
    pub links: Vec<Link>,
    /// From arrival at the gate until the command is in effect \[ns\].
    pub held_ns: u64,
}

impl Chain {
    /// From publication of the IMU sample to arrival at the gate \[ns\].
    #[must_use]
    pub fn from_publication_ns(&self) -> u64 {
        self.links.iter().skip(1).map(|link| link.ns).sum()
    }

    /// From publication of the IMU sample until the command is in effect \[ns\].
    #[must_use]
    pub fn until_effect_ns(&self) -> u64 {
        self.from_publication_ns() + self.held_ns
    }

    /// From the intended release of the IMU sample to arrival at the gate \[ns\].
    #[must_use]
    pub fn from_release_ns(&self) -> u64 {
        self.links.iter().map(|link| link.ns).sum()
    }
}

/// All that were found, and how many were not.
#[derive(Debug, Clone, Default)]
pub struct Chains {
    /// After the warm-up, in order.
    pub warm: Vec<Chain>,
    /// In the warm-up.
    pub cold: u64,
    /// Commands after the warm-up that arrived and cannot be followed back. Before, a controller may
    /// have stepped without having received an estimate.
    pub untraced: u64,
    /// Commands that nothing shows at the gate: the next one came before they took effect.
    pub unseen: u64,
}

impl Chains {
    /// Of the attitude loop's commands.
    #[must_use]
    pub fn of_attitude(watch: &Stopwatch, window: &Window) -> Self {
        let log = Log::new(watch);
        let mut chains = Self::default();
        for command in log.of(topics::WRENCH_COMMAND.info.name) {
            let Some(gate_ns) = log.at_gate(command) else {
                chains.unseen += 1;
                continue;
            };
            let chain = log.begin(command).map(|(imu, mut links)| {
                links.extend(into_step("wait of the attitude loop", command));
                links.push(computed("attitude step", command));
                links.push(span("hop to the gate", command.publish_mono_ns, gate_ns));
                let held_ns = window.mono_ns_of(command.valid_ns).saturating_sub(gate_ns);
                Chain { release_ns: imu.release_ns, links, held_ns }
            });
            chains.take(command, chain, window);
        }
        chains
    }

    /// Of the position loop's set points, through the first command of the attitude loop that uses them.
    #[must_use]
    pub fn of_position(watch: &Stopwatch, window: &Window) -> Self {
        let log = Log::new(watch);
        let commands: BTreeMap<(u32, u64), &Stamp> = log
            .of(topics::WRENCH_COMMAND.info.name)
            .map(|command| ((command.seat, command.release_ns), command))
            .collect();
        let mut used = BTreeMap::new();
        for applied in log.of(topics::APPLIED_SETPOINT.info.name) {
            if let Some(command) = commands.get(&(applied.seat, applied.release_ns)) {
                let setpoint = (applied.applied_seat, applied.applied_sequence);
                let first = used.entry(setpoint).or_insert(*command);
                if command.release_ns < first.release_ns {
                    *first = command;
                }
            }
        }
        let mut chains = Self::default();
        for setpoint in log.of(topics::ATTITUDE_SETPOINT.info.name) {
            let Some(command) = used.get(&(setpoint.seat, setpoint.sequence)) else {
                chains.unseen += 1;
                continue;
            };
            let Some(gate_ns) = log.at_gate(command) else {
                chains.unseen += 1;
                continue;
            };
            let chain = log.begin(setpoint).map(|(imu, mut links)| {
                links.extend(into_step("wait of the position loop", setpoint));
                links.push(computed("position step", setpoint));
                links.push(span(SETPOINT_HOLD, setpoint.publish_mono_ns, command.start_mono_ns));
                links.push(computed("attitude step", command));
                links.push(span("hop to the gate", command.publish_mono_ns, gate_ns));
                let held_ns = window.mono_ns_of(command.valid_ns).saturating_sub(gate_ns);
                Chain { release_ns: imu.release_ns, links, held_ns }
            });
            chains.take(setpoint, chain, window);
        }
        chains
    }

    fn take(&mut self, command: &Stamp, chain: Option<Chain>, window: &Window) {
        match chain {
            Some(chain) if window.is_warm(chain.release_ns) => self.warm.push(chain),
            None if window.is_warm(command.release_ns) => self.untraced += 1,
            _ => self.cold += 1,
        }
    }

    /// Names of the links, in order.
    #[must_use]
    pub fn names(&self) -> Vec<&'static str> {
        let links = self.warm.first().map(|chain| chain.links.as_slice()).unwrap_or_default();
        links.iter().map(|link| link.name).collect()
    }

    /// Durations of one link.
    #[must_use]
    pub fn link(&self, index: usize) -> Series {
        self.warm.iter().filter_map(|chain| chain.links.get(index)).map(|link| link.ns).collect()
    }

    /// Durations of the whole way from publication of the IMU sample.
    #[must_use]
    pub fn from_publication(&self) -> Series {
        self.warm.iter().map(Chain::from_publication_ns).collect()
    }

    /// Durations from publication of the IMU sample until the command is in effect.
    #[must_use]
    pub fn until_effect(&self) -> Series {
        self.warm.iter().map(Chain::until_effect_ns).collect()
    }

    /// Durations of the whole way from the intended release of the IMU sample.
    #[must_use]
    pub fn from_release(&self) -> Series {
        self.warm.iter().map(Chain::from_release_ns).collect()
    }
}

fn span(name: &'static str, from_ns: u64, to_ns: u64) -> Link {
    Link { name, ns: to_ns.saturating_sub(from_ns) }
}

fn computed(name: &'static str, step: &Stamp) -> Link {
    span(name, step.start_mono_ns, step.publish_mono_ns)
}

/// From arrival to the start of a step; nothing if the stamp has no arrival time.
fn into_step(name: &'static str, step: &Stamp) -> [Link; 1] {
    [span(name, arrival_ns(step), step.start_mono_ns)]
}

fn arrival_ns(step: &Stamp) -> u64 {
    if step.receive_mono_ns == 0 { step.start_mono_ns } else { step.receive_mono_ns }
}

/// Samples by what names them.
struct Log<'a> {
    watch: &'a Stopwatch,
    imu: Vec<Stamp>,
    estimates: Vec<Stamp>,
    /// Arrival of each command that was applied, by seat and sequence \[ns\].
    gate: BTreeMap<(u32, u64), u64>,
}

impl<'a> Log<'a> {
    fn new(watch: &'a Stopwatch) -> Self {
        let sorted = |topic| watch.stamps.get(topic).map(|s| by_sequence(s)).unwrap_or_default();
        let mut log = Self {
            watch,
            imu: sorted(topics::IMU.info.name),
            estimates: sorted(topics::STATE_ESTIMATE.info.name),
            gate: BTreeMap::new(),
        };
        for tick in by_sequence(watch.stamps.get("applied_command").map_or(&[], Vec::as_slice)) {
            // The stamp is of the newest command; an older one that is still applied has had its own.
            if tick.input_sequence == tick.applied_sequence {
                let key = (tick.applied_seat, tick.applied_sequence);
                log.gate.entry(key).or_insert_with(|| arrival_ns(&tick));
            }
        }
        log
    }

    fn of(&self, topic: &str) -> impl Iterator<Item = &'a Stamp> + use<'a> {
        self.watch.stamps.get(topic).into_iter().flatten()
    }

    fn at_gate(&self, command: &Stamp) -> Option<u64> {
        self.gate.get(&(command.seat, command.sequence)).copied()
    }

    /// From the sensor to the reader of the estimate: the IMU sample, and its way into the reader.
    fn begin(&self, reader: &Stamp) -> Option<(&Stamp, Vec<Link>)> {
        let estimate = find(&self.estimates, reader.input_sequence)?;
        let imu = find(&self.imu, estimate.cause_sequence)?;
        let links = vec![
            span("plant step", imu.release_mono_ns, imu.publish_mono_ns),
            span("hop to the estimator", imu.publish_mono_ns, arrival_ns(estimate)),
            span("wait of the estimator", arrival_ns(estimate), estimate.start_mono_ns),
            computed("estimator step", estimate),
            span("hop to the controller", estimate.publish_mono_ns, arrival_ns(reader)),
        ];
        Some((imu, links))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window { warm_ns: 0, start_mono_ns: 0, end_ns: 1_000_000_000 };

    fn stamp(sequence: u64, receive: u64, start: u64, publish: u64) -> Stamp {
        Stamp {
            sequence,
            release_mono_ns: 100,
            receive_mono_ns: receive,
            start_mono_ns: start,
            publish_mono_ns: publish,
            ..Stamp::default()
        }
    }

    /// One IMU sample, one estimate, one command that uses the set point before it, one tick.
    fn flown() -> Stopwatch {
        let imu = stamp(5, 0, 110, 150);
        let estimate = Stamp { cause_sequence: 5, input_sequence: 5, ..stamp(9, 170, 175, 200) };
        let reads = |stamp: Stamp| Stamp { cause_sequence: 5, input_sequence: 9, ..stamp };
        let setpoint = reads(stamp(3, 210, 220, 300));
        let command =
            Stamp { release_ns: 2000, valid_ns: 3000, ..reads(stamp(4, 230, 1240, 1280)) };
        let applied =
            Stamp { release_ns: 2000, applied_sequence: 3, ..reads(stamp(4, 230, 1240, 1280)) };
        let tick = Stamp { input_sequence: 4, applied_sequence: 4, ..stamp(11, 1300, 1350, 1360) };
        let stamps = [
            ("imu", imu),
            ("state_estimate", estimate),
            ("attitude_setpoint", setpoint),
            ("wrench_command", command),
            ("applied_setpoint", applied),
            ("applied_command", tick),
        ];
        let stamps = stamps.into_iter().map(|(topic, stamp)| (topic, vec![stamp])).collect();
        Stopwatch::of_stamps(stamps)
    }

    fn durations(chains: &Chains) -> Vec<u64> {
        chains.warm[0].links.iter().map(|link| link.ns).collect()
    }

    #[test]
    fn links_of_the_attitude_path_add_up_to_its_ends() {
        let chains = Chains::of_attitude(&flown(), &WINDOW);
        assert_eq!(durations(&chains), [50, 20, 5, 25, 30, 1010, 40, 20]);
        assert_eq!(chains.warm[0].from_release_ns(), 1300 - 100);
        assert_eq!(chains.warm[0].from_publication_ns(), 1300 - 150);
        assert_eq!(chains.warm[0].until_effect_ns(), 3000 - 150);
        assert_eq!((chains.untraced, chains.unseen), (0, 0));
    }

    #[test]
    fn the_position_path_goes_through_the_command_that_used_the_set_point_first() {
        let chains = Chains::of_position(&flown(), &WINDOW);
        assert_eq!(durations(&chains), [50, 20, 5, 25, 10, 10, 80, 940, 40, 20]);
        assert_eq!(chains.warm[0].from_release_ns(), 1300 - 100);
    }

    #[test]
    fn a_set_point_of_another_seat_is_not_taken_for_the_one_of_its_number() {
        let mut shadowed = flown();
        let setpoints = shadowed.stamps.get_mut("attitude_setpoint").unwrap();
        // A standby that counts as the owner does.
        let standby = Stamp { seat: 1, publish_mono_ns: 260, ..setpoints[0] };
        setpoints.push(standby);
        let chains = Chains::of_position(&shadowed, &WINDOW);
        assert_eq!((chains.warm.len(), chains.unseen, chains.untraced), (1, 1, 0));
        assert_eq!(durations(&chains), [50, 20, 5, 25, 10, 10, 80, 940, 40, 20]);
    }

    #[test]
    fn a_command_without_its_estimate_is_counted_and_so_is_one_that_was_never_applied() {
        let mut lost = flown();
        lost.stamps.remove("state_estimate");
        assert_eq!(Chains::of_attitude(&lost, &WINDOW).untraced, 1);
        let later = Window { warm_ns: 2001, ..WINDOW };
        let chains = Chains::of_attitude(&lost, &later);
        assert_eq!((chains.untraced, chains.cold), (0, 1), "the warm-up is not judged");
        let mut overtaken = flown();
        overtaken.stamps.remove("applied_command");
        let chains = Chains::of_attitude(&overtaken, &WINDOW);
        assert_eq!((chains.untraced, chains.unseen, chains.warm.len()), (0, 1, 0));
    }
}
