//! Flights in which a controller of the catalogue is swapped in, judged by the ground truth.

use crate::Entry;
use document::ScenarioError;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use observe::Observer;
use record::read::RecordedFlight;
use scenario::{Override, Scenario};
use serde::{Deserialize, Serialize};
use shared_types::{
    GateMode, Header, OwnerRecord, Sample, Slot, Topic, Trip, TripCause, Truth, topics,
};
use simulate::in_process::{Conclusion, InProcess, InProcessError, Outside, StateSource};
use std::any::Any;
use std::path::Path;
use swap::{SwapEnd, SwapReport};

/// Tilt beyond which a vehicle counts as lost \[rad\].
const LOST_TILT_RAD: f64 = core::f64::consts::FRAC_PI_2;
/// Distance from the flight without a swap beyond which a vehicle counts as lost \[m\].
const LOST_AWAY_M: f64 = 2.0;
/// Height below which the vehicle stands on the ground, with the radius of rotors and landing gear \[m\].
const GROUND_M: f64 = 0.05;
/// Distance from the flight without a swap within which a vehicle counts as recovered \[m\].
const BACK_M: f64 = 0.35;
/// Time at the end of a flight for which it must stay within that distance \[ns\].
const BACK_NS: u64 = 300_000_000;
/// Instant at which the candidate joins \[s\]: after the start, before the arms move.
const JOIN_S: f64 = 1.5;
/// For how long after that, in a flight with two swaps, the first candidate has been there when the second joins \[s\]:
/// its rollback window is over.
const PAIRED_S: f64 = 3.0;
/// The cause of a trip that predicts a distance.
const PREDICTS: TripCause = TripCause::PositionDeparts;
/// Duration of the shadow phase \[s\].
const SHADOW_S: f64 = 1.0;
/// Duration of the shadow phase of a forced swap \[s\]; it is shorter than 0.7 s, so that the NaN of that
/// entry comes after the flip.
const FORCED_SHADOW_S: f64 = 0.4;

/// The scenario in which a controller is swapped.
#[derive(Debug, Clone, Copy)]
pub struct Situation {
    /// Name in tables and messages.
    pub name: &'static str,
    scenario: &'static str,
    set: &'static [&'static str],
    /// Orders as of `--goto` and `--morph`.
    orders: [&'static [&'static str]; 2],
}

/// Hover, figure eight with its sweeps, sweeps alone, gusts, close to the ground, and by order from place to place. The
/// arms move in all of them, because some faults show only then.
pub const SITUATIONS: [Situation; 6] = [
    Situation {
        name: "hover",
        scenario: "hover",
        set: &["pilot.morph=[[0.0,45.0],[6.0,45.0],[6.5,160.0],[7.5,160.0],[8.0,45.0]]"],
        orders: [&[], &[]],
    },
    Situation { name: "figure8", scenario: "figure8-morph", set: &[], orders: [&[], &[]] },
    Situation {
        name: "sweep",
        scenario: "hover",
        set: &[
            "pilot.morph=[[0.0,45.0],[2.0,45.0],[2.5,160.0],[3.0,160.0],[3.4,45.0],[5.0,45.0],[5.3,160.0],[8.0,160.0],[8.3,45.0]]",
        ],
        orders: [&[], &[]],
    },
    Situation {
        name: "gusts",
        scenario: "hover",
        set: &[
            "disturbance_injector.script=[{kind=\"wind\",mean_w_m_s=[3.0,1.0,0.0],sigma_m_s=[1.5,1.5,0.5]}]",
            "pilot.morph=[[0.0,45.0],[7.0,45.0],[7.5,160.0],[8.0,160.0],[8.4,45.0]]",
        ],
        orders: [&[], &[]],
    },
    Situation {
        name: "low",
        scenario: "hover",
        set: &[
            "start.position_w_m=[0.0,0.0,0.4]",
            "pilot.morph=[[0.0,45.0],[6.0,45.0],[6.5,160.0],[7.5,160.0],[8.0,45.0]]",
        ],
        orders: [&[], &[]],
    },
    Situation {
        name: "orders",
        scenario: "hover",
        set: &[],
        orders: [&["0.5,0.3,1.5,90@5s", "0.0,0.0,1.2,0@8.5s"], &["150@6s,over=1s"]],
    },
];

/// The safeguards against a bad controller in a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Guard {
    /// Admission check, rehearsal and monitor, as configured by default.
    All,
    /// The monitor alone: the swap is forced and not rehearsed.
    Watch,
    /// None: the swap is forced and not rehearsed, and the monitor is disabled.
    None,
}

impl Guard {
    /// Name in tables and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Watch => "watch alone",
            Self::None => "none",
        }
    }
}

/// Ground truth, trips and rotor cuts of a flight.
#[derive(Debug, Default)]
struct Course {
    truths: Vec<Truth>,
    trips: Vec<Trip>,
    /// Epoch of the last owner record of each slot, in the order of [`Slot::ALL`].
    epochs: [u64; Slot::COUNT],
    cut: bool,
    /// First step of a candidate in each slot, in the order of [`Slot::ALL`] \[ns\].
    first_ns: [Option<u64>; 2],
    /// Additional delay of the trips of the monitor \[ns\].
    trips_later_ns: u64,
}

impl Course {
    /// Notes the first step of whichever joins a slot in flight: the first owner is on the first seat.
    fn note_step<T: Sample>(&mut self, topic: &Topic<T>, sample: &T) {
        let Header { seat, release_ns, .. } = *sample.header();
        let slots = Slot::ALL.into_iter().zip(&mut self.first_ns);
        for (_, first_ns) in slots.filter(|(slot, _)| topic.info.from == slot.role() && seat > 0) {
            first_ns.get_or_insert(release_ns);
        }
    }
}

impl Observer for Course {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        self.note_step(topic, sample);
        let any: &dyn Any = sample;
        self.truths.extend(any.downcast_ref::<Truth>());
        self.trips.extend(any.downcast_ref::<Trip>());
        if let Some(record) = any.downcast_ref::<OwnerRecord>() {
            let slots = Slot::ALL.into_iter().zip(&mut self.epochs);
            let of_slot = slots.filter(|(slot, _)| slot.role() == record.slot);
            of_slot.for_each(|(_, epoch)| *epoch = record.epoch);
        }
        if let Some(applied) = any.downcast_ref::<shared_types::AppliedCommand>() {
            self.cut |= applied.mode == GateMode::Cut;
        }
    }

    fn alter<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &mut T) {
        let any: &mut dyn Any = sample;
        if let Some(trip) = any.downcast_mut::<Trip>() {
            trip.header.valid_ns += self.trips_later_ns;
        }
    }
}

/// Result of a flight with a swap, compared with the same flight without one.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Swapped {
    /// How the vehicle was lost; `None` if it was not.
    pub lost: Option<String>,
    /// True if the vehicle stayed off the ground with its rotors turning, and was close to the flight without
    /// a swap at the end, however far it had tilted meanwhile.
    pub recovered: bool,
    /// Largest distance from the flight without a swap at the same instant \[m\].
    pub excursion_m: f64,
    /// Largest tilt in excess of that without the swap at the same instant \[deg\].
    pub tilt_deg: f64,
    /// True if the candidate ever commanded.
    pub flipped: bool,
    /// Trips by slot, in the order of [`Slot::ALL`].
    pub trips: [usize; Slot::COUNT],
    /// Epoch of the last owner record of each slot, in that order.
    pub epochs: [u64; Slot::COUNT],
    /// Effective instant of the first trip \[s\]; `None` if there was no trip.
    pub tripped_s: Option<f64>,
    /// Time from the first step of the slot's candidate to that instant \[s\].
    pub tripped_after_s: Option<f64>,
    /// Distance from the reference at which the vehicle can be stopped, as predicted by the first trip \[m\]; `None` if
    /// that trip had another reason.
    pub predicted_m: Option<f64>,
    /// How the swap ended, as the launcher reports it.
    pub outcome: String,
    /// Slots with a trip, but without a swap that is reported as taken back.
    pub unreported: Vec<String>,
}

/// The scenario of a situation in lockstep, with a seed and further settings.
fn scenario(
    situation: &Situation,
    seed: u64,
    more: &[Override],
) -> Result<Scenario, ScenarioError> {
    let set = situation.set.iter().map(|set| Override::set(set));
    let mut edits: Vec<Override> = set.collect::<Result<_, _>>()?;
    let [gotos, morphs] = situation.orders;
    let gotos = gotos.iter().map(|order| Override::goto(order));
    let orders = gotos.chain(morphs.iter().map(|order| Override::morph(order)));
    edits.extend(orders.collect::<Result<Vec<_>, _>>()?);
    edits.extend([Override::seed(seed), Override::clock("lockstep")]);
    edits.push(Override::set("scenario.duration_s=11.0")?);
    edits.extend(more.iter().cloned());
    Scenario::load(situation.scenario, &edits)
}

/// The same, with the limits of wall time as long as they can be set: a busy machine must not decide about a
/// flight in lockstep.
fn unhurried(
    situation: &Situation,
    seed: u64,
    more: &[Override],
) -> Result<Scenario, ScenarioError> {
    let limits = [
        "launcher.stall_timeout_s=600",
        "launcher.startup_timeout_s=600",
        "rehearsal.wall_max_s=600",
    ];
    let limits = limits.into_iter().map(Override::set).collect::<Result<Vec<_>, _>>()?;
    scenario(situation, seed, &[more, &limits].concat())
}

fn fly(scenario: &Scenario, trips_later_ns: u64) -> Result<(Course, Conclusion), InProcessError> {
    let outside = Outside::of(scenario.settings());
    let course = Course { trips_later_ns, ..Course::default() };
    let mut flight = InProcess::with_processes(scenario, StateSource::Estimator, course, &outside)?;
    flight.fly_until(u64::MAX)?;
    let conclusion = flight.conclude();
    Ok((flight.seen(core::mem::take), conclusion))
}

/// A flight without a swap, with which flights with a swap are compared.
#[derive(Debug)]
pub struct Plain {
    truths: Vec<Truth>,
    /// Settings of the scenario beyond those of the situation.
    edits: Vec<Override>,
}

/// A slot with the shipped controller that owns it from the start.
pub type Holder = (Slot, &'static str);

/// Flies a situation without a swap, with `holder` in place of the scenario's own controller and with further
/// settings.
///
/// # Errors
/// If it cannot be flown.
pub fn plain(
    situation: &Situation,
    seed: u64,
    holder: Option<Holder>,
    settings: &[Override],
) -> Result<Plain, Box<dyn std::error::Error>> {
    let mut edits = held(holder)?;
    edits.extend(settings.iter().cloned());
    let truths = fly(&unhurried(situation, seed, &edits)?, 0)?.0.truths;
    Ok(Plain { truths, edits })
}

/// The settings that make `holder` the first owner of its slot.
fn held(holder: Option<Holder>) -> Result<Vec<Override>, ScenarioError> {
    let edit = holder.map(|(slot, name)| Override::controller(&format!("{}={name}", slot.label())));
    Ok(edit.transpose()?.into_iter().collect())
}

/// Flies a situation in which `to`, a shipped controller or the path of an executable with the file that
/// configures it, is swapped into a slot.
///
/// # Errors
/// If it cannot be flown.
pub fn swapped(
    (situation, seed): (&Situation, u64),
    slot: Slot,
    (to, config): (&str, Option<&Path>),
    guard: Guard,
    plain: &Plain,
) -> Result<Swapped, Box<dyn std::error::Error>> {
    swapped_with_late_trips((situation, seed), slot, (to, config), (guard, 0), plain)
}

/// Flies a situation in which `to`, a shipped controller or the path of an executable, is swapped into a slot at
/// `join_s` \[s\], with the defaults of all options.
///
/// # Errors
/// If it cannot be flown.
pub fn swapped_at(
    (situation, seed): (&Situation, u64),
    (slot, join_s): (Slot, f64),
    to: &str,
    plain: &Plain,
) -> Result<Swapped, Box<dyn std::error::Error>> {
    let mut more = plain.edits.clone();
    more.push(Override::swap(&format!("{}={to}@{join_s}s", slot.label()))?);
    let (course, conclusion) = fly(&unhurried(situation, seed, &more)?, 0)?;
    Ok(judge(&course, plain, &reported_swaps(&conclusion)))
}

/// The same as [`swapped`], with trips that take effect `trips_later_ns` \[ns\] later than the monitor
/// publishes. The largest delay that the vehicle survives is the margin of its trip before the point of no
/// return.
///
/// # Errors
/// If it cannot be flown.
pub fn swapped_with_late_trips(
    (situation, seed): (&Situation, u64),
    slot: Slot,
    (to, config): (&str, Option<&Path>),
    (guard, trips_later_ns): (Guard, u64),
    plain: &Plain,
) -> Result<Swapped, Box<dyn std::error::Error>> {
    let mut more = plain.edits.clone();
    more.extend(swap(slot, (to, config), JOIN_S, guard)?);
    let (course, conclusion) = fly(&unhurried(situation, seed, &more)?, trips_later_ns)?;
    Ok(judge(&course, plain, &reported_swaps(&conclusion)))
}

/// Flies a situation in which first an attitude controller is forced in, which may be one that no rehearsal would let
/// pass, and then a position controller is swapped in with all safeguards. The flight without a swap must have been flown
/// with [`pair_settings`].
///
/// # Errors
/// If it cannot be flown.
pub fn paired(
    (situation, seed): (&Situation, u64),
    [attitude, position]: [(&str, Option<&Path>); 2],
    plain: &Plain,
) -> Result<Swapped, Box<dyn std::error::Error>> {
    let mut more = plain.edits.clone();
    more.extend(swap(Slot::Attitude, attitude, JOIN_S, Guard::Watch)?);
    more.extend(swap(Slot::Position, position, JOIN_S + PAIRED_S, Guard::All)?);
    let (course, conclusion) = fly(&unhurried(situation, seed, &more)?, 0)?;
    Ok(judge(&course, plain, &reported_swaps(&conclusion)))
}

/// Settings with which a flight lasts long enough for two swaps.
///
/// # Panics
/// Never: the setting exists.
#[must_use]
pub fn pair_settings() -> Vec<Override> {
    vec![Override::set("scenario.duration_s=14.0").expect("a setting")]
}

/// The settings of a scripted swap with a candidate that joins at `join_s` \[s\].
fn swap(
    slot: Slot,
    (to, config): (&str, Option<&Path>),
    join_s: f64,
    guard: Guard,
) -> Result<Vec<Override>, ScenarioError> {
    let shadow_s = if guard == Guard::All { SHADOW_S } else { FORCED_SHADOW_S };
    let mut swap = format!("{}={to}@{join_s}s,shadow={shadow_s}s,rollback=500ms", slot.label());
    if let Some(config) = config {
        swap = format!("{swap},config={}", config.display());
    }
    let mut edits = Vec::new();
    if guard != Guard::All {
        swap.push_str(",no-rehearsal,force");
    }
    if guard == Guard::None {
        edits.push(Override::set("monitor.enabled=false")?);
        edits.push(Override::set("monitor.fallback=\"none\"")?);
    }
    edits.push(Override::swap(&swap)?);
    Ok(edits)
}

/// The same as [`swapped`] in realtime: the executable `morphquad` flies it in processes, and its recording is
/// judged. Also returns the number of releases that the loops missed.
///
/// # Errors
/// If it cannot be flown, or has left no recording.
pub fn swapped_in_realtime(
    morphquad: &Path,
    (situation, seed): (&Situation, u64),
    slot: Slot,
    (to, config): (&str, Option<&Path>),
    guard: Guard,
    plain: &Plain,
) -> Result<(Swapped, u64), Box<dyn std::error::Error>> {
    let folder = tempfile::TempDir::new()?;
    let mut more = plain.edits.clone();
    more.extend(swap(slot, (to, config), JOIN_S, guard)?);
    more.push(Override::clock("realtime"));
    let file = folder.path().join("flight.toml");
    std::fs::write(&file, scenario(situation, seed, &more)?.to_toml())?;
    let output = std::process::Command::new(morphquad)
        .arg("run")
        .arg(&file)
        .args(["--format", "json", "--record"])
        .arg(folder.path())
        .stdin(std::process::Stdio::null())
        .output()?;
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout)
        .map_err(|error| format!("no summary ({error}): {stderr}"))?;
    let recording = summary["recording"].as_str().ok_or("no recording")?;
    let recorded = RecordedFlight::open(recording.as_ref())?;
    let applied = recorded.samples(&topics::APPLIED_COMMAND)?;
    let mut course = Course {
        truths: recorded.samples(&topics::TRUTH)?,
        trips: recorded.samples(&topics::TRIP)?,
        cut: applied.iter().any(|applied| applied.mode == GateMode::Cut),
        ..Course::default()
    };
    recorded.samples(&topics::WRENCH_COMMAND)?.iter().for_each(|command| {
        course.note_step(&topics::WRENCH_COMMAND, command);
    });
    recorded.samples(&topics::ATTITUDE_SETPOINT)?.iter().for_each(|command| {
        course.note_step(&topics::ATTITUDE_SETPOINT, command);
    });
    let of = |swap: &serde_json::Value| ReportedSwap {
        slot: swap["slot"].as_str().and_then(Slot::named),
        flipped: swap["flipped_s"].is_number(),
        taken_back: swap["ended"] == "taken-back",
        outcome: swap["outcome"].as_str().unwrap_or_default().to_owned(),
    };
    let swaps: Vec<ReportedSwap> =
        summary["swaps"].as_array().into_iter().flatten().map(of).collect();
    let missed = summary["missed_ticks"].as_u64().unwrap_or_default();
    Ok((judge(&course, plain, &swaps), missed))
}

fn tilt_rad(truth: &Truth) -> f64 {
    let q = truth.q_wb;
    let q_wb = UnitQuaternion::new_normalize(Quaternion::new(q.w, q.x, q.y, q.z));
    q_wb.transform_vector(&Vector3::z()).angle(&Vector3::z())
}

/// What the launcher reports about a swap.
struct ReportedSwap {
    slot: Option<Slot>,
    flipped: bool,
    taken_back: bool,
    outcome: String,
}

fn reported_swaps(conclusion: &Conclusion) -> Vec<ReportedSwap> {
    let of = |swap: &SwapReport| ReportedSwap {
        slot: Slot::named(swap.slot),
        flipped: swap.flipped_s.is_some(),
        taken_back: swap.ended == SwapEnd::TakenBack,
        outcome: swap.outcome.clone(),
    };
    conclusion.swaps.iter().map(of).collect()
}

/// Slots with a trip, but without a swap that is reported as taken back.
fn unreported(trips: &[Trip], swaps: &[ReportedSwap]) -> Vec<&'static str> {
    let slots = Slot::ALL.into_iter().filter(|slot| {
        let has_tripped = trips.iter().any(|trip| trip.slot == slot.role());
        has_tripped && !swaps.iter().any(|swap| swap.slot == Some(*slot) && swap.taken_back)
    });
    slots.map(Slot::label).collect()
}

/// Judges a flight; flip and outcome are those of its last swap.
fn judge(course: &Course, plain: &Plain, swaps: &[ReportedSwap]) -> Swapped {
    let mut lost = course.cut.then(|| "its rotors were cut".to_owned());
    let (mut excursion_m, mut more_tilt_rad) = (0.0_f64, 0.0_f64);
    let last_ns = |truths: &[Truth]| truths.last().map(|truth| truth.header.release_ns);
    let back_ns = last_ns(&plain.truths).unwrap_or_default().saturating_sub(BACK_NS);
    let mut recovered = !course.cut && last_ns(&course.truths) >= last_ns(&plain.truths);
    for is in &course.truths {
        // A realtime flight has no sample for a release that it missed.
        let at = plain.truths.binary_search_by_key(&is.header.release_ns, |t| t.header.release_ns);
        let Some(was) = at.ok().and_then(|at| plain.truths.get(at)) else { continue };
        let at_s = is.header.release_ns as f64 * 1e-9;
        let away = Vector3::from(is.position_w_m) - Vector3::from(was.position_w_m);
        excursion_m = excursion_m.max(away.norm());
        let is_back = away.norm() < BACK_M || is.header.release_ns < back_ns;
        recovered &= is_back && is.position_w_m[2] >= GROUND_M;
        let tilt = tilt_rad(is);
        more_tilt_rad = more_tilt_rad.max(tilt - tilt_rad(was));
        let why = if tilt > LOST_TILT_RAD {
            Some(format!("tilt {:.0} deg", tilt.to_degrees()))
        } else if is.position_w_m[2] < GROUND_M {
            Some("on the ground".to_owned())
        } else if away.norm() > LOST_AWAY_M {
            Some(format!("{:.1} m away", away.norm()))
        } else if !away.norm().is_finite() {
            Some("no number".to_owned())
        } else {
            None
        };
        if lost.is_none() {
            lost = why.map(|why| format!("{why} at {at_s:.2} s"));
        }
    }
    if last_ns(&course.truths) < last_ns(&plain.truths) && lost.is_none() {
        lost = Some("the flight ended early".to_owned());
    }
    Swapped {
        lost,
        recovered,
        excursion_m,
        tilt_deg: more_tilt_rad.to_degrees(),
        flipped: swaps.last().is_some_and(|swap| swap.flipped),
        predicted_m: course
            .trips
            .first()
            .filter(|trip| trip.cause == PREDICTS && trip.lasted_s <= 0.0)
            .map(|t| t.distance_m),
        trips: Slot::ALL
            .map(|slot| course.trips.iter().filter(|trip| trip.slot == slot.role()).count()),
        epochs: course.epochs,
        tripped_s: course.trips.first().map(|trip| trip.header.valid_ns as f64 * 1e-9),
        tripped_after_s: course.trips.first().and_then(|trip| {
            let slots = Slot::ALL.into_iter().zip(course.first_ns);
            let (_, first_ns) = slots.into_iter().find(|(slot, _)| slot.role() == trip.slot)?;
            Some(trip.header.valid_ns.checked_sub(first_ns?)? as f64 * 1e-9)
        }),
        outcome: swaps.last().map_or_else(String::new, |swap| swap.outcome.clone()),
        unreported: unreported(&course.trips, swaps).into_iter().map(str::to_owned).collect(),
    }
}

/// Content of the configuration file with which the executable `catalogue` flies an entry.
///
/// # Panics
/// Never: an entry has no value that TOML does not have.
#[must_use]
pub fn config_of(entry: &Entry) -> String {
    toml::to_string(entry).expect("a table of texts and numbers")
}
