//! What happened and when, for the time axis.

use disturbance_injector::Event;
use observe::TIMING;
use record::Clock;
use record::read::{RecordVisitor, RecordedEvent};
use serde::Serialize;
use shared_types::{
    Disturbance, DisturbanceKind, DisturbanceOrder, GateMode, GuidanceOrder, OwnerRecord, Role,
    Sample, Slot, Topic, TopicInfo,
};
use std::any::Any;
use swap::FAULT;
use timing::Script;

/// Troubles of the gate that come closer together than this are one: its beginning and whatever is worse
/// are marks, the rest is in the list \[ns\].
const EPISODE_NS: u64 = 2_000_000_000;

/// What kind of thing; the page has a sign for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Kind {
    /// A change of a slot's owner, or a step of such a change.
    Swap,
    /// Something failed.
    Fault,
    /// The world did something.
    Disturbance,
    /// A user asked for something.
    Order,
    /// Any other logged event.
    Note,
}

/// One thing that happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Happening {
    /// Logical time \[s\].
    pub(crate) at_s: f64,
    /// How long it goes on, if that is known: shown as a band through every chart \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) until_s: Option<f64>,
    pub(crate) kind: Kind,
    /// Shown as a line through every chart.
    pub(crate) is_mark: bool,
    pub(crate) source: String,
    pub(crate) text: String,
}

impl Happening {
    fn mark(at_ns: u64, kind: Kind, source: &str, text: String) -> Self {
        let at_s = at_ns as f64 * 1e-9;
        Self { at_s, until_s: None, kind, is_mark: true, source: source.to_owned(), text }
    }

    /// A logged event; its stamp is Unix time that runs like the flight's clock.
    pub(super) fn from_event(event: RecordedEvent, epoch_unix_ns: u64, clock: Clock) -> Self {
        let at_s = event.at_s(epoch_unix_ns, clock);
        let kind = match event.level {
            // So many on a busy machine that they would hide everything else; a chart has them all.
            3.. if event.source == TIMING => Kind::Note,
            3.. => Kind::Fault,
            _ if event.text.starts_with(FAULT) => Kind::Fault,
            _ if event.text.contains(" slot: ") => Kind::Swap,
            _ => Kind::Note,
        };
        let is_mark = kind == Kind::Fault;
        Self { at_s, until_s: None, kind, is_mark, source: event.source, text: event.text }
    }
}

/// The seat that commands each slot, and since when.
#[derive(Debug, Default)]
pub(crate) struct Owners {
    /// Instant \[ns\], slot, seat.
    changes: Vec<(u64, Role, u32)>,
    pub(crate) happenings: Vec<Happening>,
}

impl RecordVisitor for Owners {
    fn wants(&self, topic: &TopicInfo) -> bool {
        Slot::of_owner_records(topic).is_some()
    }

    fn sample<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        let Some(record) = any.downcast_ref::<OwnerRecord>() else { return };
        let OwnerRecord { header, epoch, owner, slot, .. } = *record;
        let before = self.owner_at(slot, u64::MAX);
        if before != Some(owner) {
            if before.is_some() {
                let text = format!("{} slot: seat {owner} commands from now on", slot.label());
                let text = format!("{text}, epoch {epoch}");
                let flip = Happening::mark(header.valid_ns, Kind::Swap, "supervisor", text);
                self.happenings.push(flip);
            }
            self.changes.push((header.valid_ns, slot, owner));
        }
    }
}

impl Owners {
    /// Seat that commands a slot at an instant; `None` before the first.
    pub(super) fn owner_at(&self, slot: Role, t_ns: u64) -> Option<u32> {
        let mut known = self.changes.iter().rev();
        known.find(|(from_ns, of, _)| *of == slot && *from_ns <= t_ns).map(|(_, _, seat)| *seat)
    }
}

/// Sets the end of each happening that a timing script causes, at most to the end of the flight.
pub(super) fn end(happenings: &mut [Happening], script: &Script, until_s: f64) {
    for (window, text) in script.announced() {
        let text = format!("{FAULT}{text}");
        let matching = happenings.iter_mut().filter(|h| h.text == text && h.until_s.is_none());
        for happening in matching.take(1) {
            happening.until_s = Some((window.until_ns as f64 * 1e-9).min(until_s));
        }
    }
}

/// Winds of the script that begin in flight: with gusts, the samples do not show when one begins.
pub(super) fn winds(script: &[Event], until_s: f64) -> Vec<Happening> {
    let winds = script.iter().filter_map(|event| match event {
        Event::Wind(wind) if wind.at_s > 0.0 => Some(wind),
        _ => None,
    });
    let marks = winds.flat_map(|wind| {
        let mean = vector(wind.mean_w_m_s);
        let mark = |at_s: f64, text: String| {
            let (kind, source) = (Kind::Disturbance, "disturbance".to_owned());
            Happening { at_s, until_s: None, kind, is_mark: true, source, text }
        };
        let end =
            wind.until_s.map(|at_s| mark(at_s, format!("wind of {mean} m/s on average ends")));
        [Some(mark(wind.at_s, format!("wind of {mean} m/s on average begins"))), end]
    });
    marks.flatten().filter(|mark| mark.at_s <= until_s).collect()
}

/// Notices when the world changes other than by wind.
#[derive(Debug, Default)]
pub(super) struct World {
    last: Option<Disturbance>,
    /// None before the first tick that is seen.
    gate: Option<GateMode>,
    /// Worst mode of the gate's troubles of late, and when they are over unless there is another \[ns\].
    episode: (GateMode, u64),
    guidance: GuidanceOrder,
    /// Number of the last disturbance that was ordered.
    ordered: u64,
}

impl World {
    /// What a new sample of the disturbance begins.
    pub(super) fn disturbance(&mut self, now: &Disturbance) -> Option<Happening> {
        let before = self.last.replace(*now);
        let calm = Disturbance { rotor_efficiency: [1.0; 4], ..Disturbance::default() };
        let before = before.unwrap_or(calm);
        let mut changes = Vec::new();
        if !is_none(now.body_rate_kick_b_rad_s) {
            changes
                .push(format!("body rate kicked by {} rad/s", vector(now.body_rate_kick_b_rad_s)));
        }
        if is_none(before.force_w_n) && !is_none(now.force_w_n) {
            changes.push(format!("force of {} N begins", vector(now.force_w_n)));
        }
        if is_none(before.torque_b_nm) && !is_none(now.torque_b_nm) {
            changes.push(format!("torque of {} N m begins", vector(now.torque_b_nm)));
        }
        if before.payload_kg.to_bits() != now.payload_kg.to_bits() {
            changes.push(format!("payload is {} kg", now.payload_kg));
        }
        for (i, (was, is)) in before.rotor_efficiency.iter().zip(now.rotor_efficiency).enumerate() {
            if was.to_bits() != is.to_bits() {
                changes.push(format!("rotor {} gives {:.0} % of its thrust", i + 1, is * 100.0));
            }
        }
        let text = changes.join(", ");
        let at_ns = now.header.valid_ns;
        (!text.is_empty()).then(|| Happening::mark(at_ns, Kind::Disturbance, "disturbance", text))
    }

    /// Where the vehicle is sent from now on, and how wide it is to be.
    pub(super) fn guidance(&mut self, now: &GuidanceOrder) -> Vec<Happening> {
        let before = core::mem::replace(&mut self.guidance, *now);
        let GuidanceOrder { position, yaw, morph, .. } = now;
        let mut orders = Vec::new();
        let mut add = |is: bool, begin_ns: u64, before_ns: u64, text: String| {
            if is && begin_ns != before_ns {
                orders.push(Happening::mark(begin_ns, Kind::Order, "order", text));
            }
        };
        let goal = format!("go to {} m", vector(position.goal_w_m));
        add(position.ordered.is_set(), position.begin_ns, before.position.begin_ns, goal);
        let heading = format!("heading {:.1}°", yaw.goal_rad.to_degrees());
        // A vehicle that is sent somewhere without an ordered heading comes to rest without a turn.
        let turns = yaw.ordered.is_set() && yaw.move_s > 0.0;
        add(turns, yaw.begin_ns, before.yaw.begin_ns, heading);
        let angle = format!("deployable angle {:.1}°", morph.goal_rad.to_degrees());
        add(morph.ordered.is_set(), morph.begin_ns, before.morph.begin_ns, angle);
        orders
    }

    /// What is done to it on purpose from now on.
    pub(super) fn disturbance_order(&mut self, now: &DisturbanceOrder) -> Vec<Happening> {
        let count = usize::try_from(now.count).unwrap_or(0).min(now.entries.len());
        let newest = self.ordered;
        let new = now.entries[..count].iter().filter(|entry| entry.number > newest);
        let orders = new.map(|entry| {
            self.ordered = self.ordered.max(entry.number);
            let what = match entry.kind {
                DisturbanceKind::Wind => format!("wind of {} m/s", vector(entry.wind_w_m_s)),
                DisturbanceKind::Force => format!("force of {} N", vector(entry.force_w_n)),
                DisturbanceKind::Torque => format!("torque of {} N m", vector(entry.torque_b_nm)),
                DisturbanceKind::Kick => {
                    format!("body rate kicked by {} rad/s", vector(entry.body_rate_kick_b_rad_s))
                }
                DisturbanceKind::Payload => format!("payload of {} kg", entry.payload_kg),
                _ => format!("rotor {} at {:.0} %", entry.rotor, entry.efficiency * 100.0),
            };
            Happening::mark(entry.begin_ns, Kind::Order, "order", what)
        });
        orders.collect()
    }

    /// True if the gate has given up.
    pub(super) fn has_cut_rotors(&self) -> bool {
        self.gate == Some(GateMode::Cut)
    }

    /// What a change of the gate's mode means.
    pub(super) fn gate(&mut self, at_ns: u64, mode: GateMode) -> Option<Happening> {
        let before = self.gate.replace(mode);
        // The first tick that is seen is no change, whatever its mode.
        if before.is_none_or(|before| before == mode) {
            return None;
        }
        let text = match mode {
            GateMode::Normal => "the gate lets commands through again",
            GateMode::Hold => "no valid command: the gate holds the last one",
            GateMode::Level => "no command that counts: the gate flies the vehicle itself",
            GateMode::Recover => {
                "the gate levels or brakes the vehicle: an owner has tripped, or was about to overturn it"
            }
            _ => "the gate has cut the rotors",
        };
        let mut happening = Happening::mark(at_ns, Kind::Fault, "plant", text.to_owned());
        let (worst, quiet_ns) = self.episode;
        let worst = if at_ns < quiet_ns { worst } else { GateMode::Normal };
        happening.is_mark = mode.0 > worst.0;
        self.episode =
            (if happening.is_mark { mode } else { worst }, at_ns.saturating_add(EPISODE_NS));
        Some(happening)
    }
}

/// True if nothing acts.
fn is_none(values: [f64; 3]) -> bool {
    values.iter().all(|value| value.abs() <= 0.0)
}

fn vector(values: [f64; 3]) -> String {
    let [x, y, z] = values;
    format!("({x:.3}, {y:.3}, {z:.3})")
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::topics;

    #[test]
    fn stamps_of_events_are_logical_time_at_any_speed() {
        let event = |level| RecordedEvent {
            stamp_ns: 7_000_000_000,
            level,
            source: "launcher".to_owned(),
            text: "attitude slot: a controller joined".to_owned(),
        };
        let happening = Happening::from_event(event(2), 5_000_000_000, Clock::Lockstep);
        assert_eq!((happening.at_s, happening.kind, happening.is_mark), (2.0, Kind::Swap, false));
        let slow = Clock::Realtime { speed: 0.5 };
        let happening = Happening::from_event(event(3), 5_000_000_000, slow);
        assert_eq!((happening.at_s, happening.kind, happening.is_mark), (1.0, Kind::Fault, true));
        let late = RecordedEvent { source: TIMING.to_owned(), ..event(3) };
        let happening = Happening::from_event(late, 5_000_000_000, slow);
        assert_eq!((happening.kind, happening.is_mark), (Kind::Note, false));
    }

    #[test]
    fn an_owner_holds_its_slot_until_the_next_and_the_first_is_no_change() {
        let mut owners = Owners::default();
        for (valid_ns, owner, epoch) in [(0, 0, 1), (5, 0, 2), (10, 1, 3)] {
            let mut record = OwnerRecord { epoch, owner, ..OwnerRecord::default() };
            record.slot = Role::Attitude;
            record.header.valid_ns = valid_ns;
            owners.sample(&topics::ATTITUDE_OWNER, &record);
        }
        assert_eq!(owners.owner_at(Role::Attitude, 9), Some(0));
        assert_eq!(owners.owner_at(Role::Attitude, 10), Some(1));
        assert_eq!(owners.owner_at(Role::Position, 10), None);
        assert_eq!(owners.happenings.len(), 1);
        assert!(owners.happenings[0].text.contains("seat 1"), "{:?}", owners.happenings);
    }

    #[test]
    fn a_wind_of_the_script_is_shown_unless_it_blows_from_the_start_or_after_the_end() {
        let script = r#"script = [
            { kind = "wind", mean_w_m_s = [1.0, 0.0, 0.0] },
            { kind = "wind", at_s = 2.0, until_s = 3.5, mean_w_m_s = [20.0, 0.0, 0.0] },
            { kind = "wind", at_s = 9.0, mean_w_m_s = [20.0, 0.0, 0.0] },
        ]"#;
        let settings: disturbance_injector::settings::Settings = toml::from_str(script).unwrap();
        let happenings = winds(&settings.script, 8.0);
        let begun = happenings.iter().map(|happening| (happening.at_s, happening.text.as_str()));
        let begun: Vec<_> = begun.collect();
        let [begins, ends] = ["begins", "ends"]
            .map(|change| format!("wind of (20.000, 0.000, 0.000) m/s on average {change}"));
        assert_eq!(begun, [(2.0, begins.as_str()), (3.5, ends.as_str())]);
    }

    #[test]
    fn a_change_of_the_world_is_shown_once() {
        let mut world = World::default();
        let mut now = Disturbance { rotor_efficiency: [1.0; 4], ..Disturbance::default() };
        assert_eq!(world.disturbance(&now), None);
        now.wind_w_m_s = [3.0, 0.0, 0.0];
        assert_eq!(world.disturbance(&now), None);
        now.payload_kg = 0.2;
        now.rotor_efficiency[2] = 0.5;
        let change = world.disturbance(&now).expect("two changes");
        assert_eq!(change.text, "payload is 0.2 kg, rotor 3 gives 50 % of its thrust");
        assert_eq!(world.disturbance(&now), None);
        let mut order = GuidanceOrder::default();
        (order.morph.goal_rad, order.morph.begin_ns) = (1.0, 7_000_000_000);
        order.morph.ordered = true.into();
        let orders = world.guidance(&order);
        assert_eq!((orders.len(), orders[0].at_s, orders[0].kind), (1, 7.0, Kind::Order));
        assert!(world.guidance(&order).is_empty());
        assert!(world.gate(0, GateMode::Hold).is_none());
        let mut gate = |at_ns, mode| world.gate(at_ns, mode).map(|happening| happening.is_mark);
        assert_eq!(gate(1, GateMode::Normal), Some(false));
        assert_eq!(gate(2, GateMode::Normal), None);
        // Trouble after trouble is one, unless it gets worse.
        let modes = [GateMode::Hold, GateMode::Normal, GateMode::Hold, GateMode::Level];
        let marks = [3, 4, 5, 6].into_iter().zip(modes).map(|(at_ns, mode)| gate(at_ns, mode));
        assert_eq!(marks.collect::<Vec<_>>(), [true, false, false, true].map(Some));
        assert_eq!(gate(EPISODE_NS + 6, GateMode::Hold), Some(true));
    }
}
