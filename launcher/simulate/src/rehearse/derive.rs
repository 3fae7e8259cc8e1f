//! Derives the scenario of a rehearsed flight: the scenario of the real flight, with the vehicle's present
//! state as initial condition and a nominal plant.

use super::facts;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use pilot::settings::Manoeuvre;
use pilot::{Trajectory, diversion};
use rehearsal::{Challenge, Draw, Facts, Guidance, Schedule, Snapshot, Turn, Way};
use scenario::orders::{FLOOR_M, REACH_M};
use scenario::services::Assignment;
use scenario::start::GuidanceSettings;
use scenario::{Plan, Scenario};
use shared_types::Slot;
use std::path::PathBuf;
use swap::RehearsalSpec;
use toml::{Table, Value};
use vehicle::{MorphAngle, euler_from_quaternion, wrap_pi};

/// Control periods that the candidate shadows the owner; it tracks the applied command during the first half.
/// A flip, even a forced one, requires ten commands in each half.
const SHADOW_PERIODS: f64 = 24.0;
/// Control periods that the flip may take after that.
const FLIP_PERIODS: f64 = 3.0;
/// Instant at which the candidate joins \[s\].
const JOIN_S: f64 = 0.001;

/// The controller that a rehearsed flight measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The candidate, which takes the slot over from the owner.
    Candidate,
    /// The owner alone.
    Owner,
    /// The candidate for the attitude slot, while the owner of the position slot trips.
    Following,
}

/// Time that a flight with a trip goes on after the position slot has changed hands \[s\], beside some periods of both
/// loops: the monitor needs some of it to find what is wrong, and the candidate some to follow.
const TRIP_S: f64 = 0.1;
/// Periods of both loops.
const TRIP_PERIODS: f64 = 5.0;

fn shadow_s(facts: &Facts, slot: Slot) -> f64 {
    SHADOW_PERIODS * facts.period_s[slot]
}

/// Latest instant at which the candidate takes over \[s\], rounded up to a multiple of 20 ms, which is a
/// release instant of every loop.
pub(super) fn flip_s(facts: &Facts, slot: Slot) -> f64 {
    let shadow_s = shadow_s(facts, slot);
    let flip_s = JOIN_S + shadow_s * (1.0 + FLIP_PERIODS / SHADOW_PERIODS);
    (flip_s * 50.0).ceil() / 50.0
}

fn numbers(values: &[f64]) -> Value {
    Value::Array(values.iter().map(|value| Value::Float(*value)).collect())
}

fn section<'t>(root: &'t mut Table, name: &str) -> &'t mut Table {
    let entry = root.entry(name).or_insert_with(|| Value::Table(Table::new()));
    if !entry.is_table() {
        *entry = Value::Table(Table::new());
    }
    match entry {
        Value::Table(table) => table,
        _ => unreachable!("it has just been made a table"),
    }
}

fn table<const N: usize>(entries: [(&str, Value); N]) -> Table {
    entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

fn set<const N: usize>(target: &mut Table, entries: [(&str, Value); N]) {
    target.extend(table(entries));
}

/// Derives the scenario of one draw, for the candidate or for the owner alone.
pub(super) fn scenario(
    spec: &RehearsalSpec,
    flown: &Scenario,
    facts: &Facts,
    (draw, schedule): (&Draw, &Schedule),
    role: Role,
) -> Result<Scenario, String> {
    let snapshot = &spec.snapshot;
    let mut root: Table = flown.to_toml().parse().map_err(|error| format!("{error}"))?;
    for list in ["swap", "standby", "fault", "order", "timing"] {
        root.remove(list);
    }
    let duration_s = match role {
        Role::Following => {
            let period_s: f64 = facts.period_s.iter().map(|(_, period_s)| period_s).sum();
            trip_from_s(facts) + TRIP_S + TRIP_PERIODS * period_s
        }
        Role::Candidate | Role::Owner => flown.settings().rehearsal.duration_s,
    };
    let name = format!("rehearsal-{}", draw.index);
    let header = section(&mut root, "scenario");
    header.remove("speed");
    set(
        header,
        [
            ("name", Value::String(name)),
            ("clock", Value::String("lockstep".to_owned())),
            ("duration_s", Value::Float(duration_s)),
            ("seed", Value::Integer(i64::try_from(draw.seed).unwrap_or(i64::MAX))),
        ],
    );
    set(section(&mut root, "rehearsal"), [("enabled", Value::Boolean(false))]);
    nominal(&mut root);
    start(&mut root, flown, snapshot, draw);
    plan(&mut root, flown);
    believe(&mut root, snapshot);
    challenges(&mut root, snapshot, schedule);
    orders(&mut root, flown, snapshot, schedule)?;
    // Unless it is about a trip, the monitor and a fallback would take command from a bad candidate and hide its errors.
    let (watched, fallback) =
        if role == Role::Following { (true, "auto") } else { (false, "none") };
    let monitor = section(&mut root, "monitor");
    // How soon and by which limits the flight's own monitor trips does not matter.
    monitor.clear();
    set(
        monitor,
        [("enabled", Value::Boolean(watched)), ("fallback", Value::String(fallback.to_owned()))],
    );
    let taken_over = match role {
        Role::Candidate | Role::Following => Some((&spec.candidate, spec.config.as_ref())),
        Role::Owner => spec.owner.as_ref().map(|(name, config)| (name, config.as_ref())),
    };
    let by = taken_over.map(|by| swap(spec.slot, by, JOIN_S, facts));
    let mut swaps: Vec<Value> = by.into_iter().collect();
    if role == Role::Following {
        let owner = Assignment::of(flown.settings()).name(Slot::Position.role()).to_owned();
        swaps.push(swap(Slot::Position, (&owner, None), flip_s(facts, Slot::Attitude), facts));
    }
    if !swaps.is_empty() {
        root.insert("swap".to_owned(), Value::Array(swaps));
    }
    let text = toml::to_string(&root).map_err(|error| error.to_string())?;
    Scenario::from_text("the rehearsal's scenario", &text, &[]).map_err(|error| {
        let problems = error.problems().map(|problem| format!("{problem}: {}", problem.remedy()));
        problems.collect::<Vec<_>>().join("; ")
    })
}

/// Sensors of the plant with the keys of the biases that they draw at the start.
const INITIAL_BIASES: [(&str, &str); 3] = [
    ("imu", "gyro_initial_bias_rad_s"),
    ("imu", "accelerometer_initial_bias_m_s2"),
    ("barometer", "initial_bias_m"),
];

/// Removes the model mismatch of the plant, the initial biases of its sensors and what is scripted of them: the
/// snapshot cannot know any of it, and a script would run anew from the beginning of the rehearsal.
fn nominal(root: &mut Table) {
    let plant = section(root, "plant");
    plant.remove("mismatch");
    for (sensor, bias) in INITIAL_BIASES {
        set(section(plant, sensor), [(bias, Value::Float(0.0))]);
    }
    for sensor in plant.iter_mut().filter_map(|(_, section)| section.as_table_mut()) {
        sensor.remove("drop_outs");
        sensor.remove("bias_step");
    }
}

fn start(root: &mut Table, flown: &Scenario, snapshot: &Snapshot, draw: &Draw) {
    let [w, x, y, z] = snapshot.q_wb;
    let believed = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let turned = UnitQuaternion::from_scaled_axis(Vector3::from(draw.attitude_b_rad));
    let gamma = euler_from_quaternion(&(believed * turned));
    let sum = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { core::array::from_fn(|i| a[i] + b[i]) };
    let minus = |a: [f64; 3]| a.map(|value| -value);
    let least_m = if flown.settings().plant.ground { 0.0 } else { f64::NEG_INFINITY };
    let mut position = sum(snapshot.position_w_m, draw.position_w_m);
    position[2] = position[2].max(least_m);
    let most_n = flown.modelled_vehicle().rotor_thrust_max_n;
    let thrusts = snapshot.rotor_thrust_n.map(|thrust_n| thrust_n.clamp(0.0, most_n));
    let beta = MorphAngle::saturating_from_rad(snapshot.morph_angle_rad).unwrap_or(MorphAngle::MIN);
    let plan_s = facts::plan_ns(flown, snapshot) as f64 / 1e9;
    let whole_s = flown.settings().start.plan_s.unwrap_or(flown.settings().scenario.duration_s);
    let guidance = guidance(&snapshot.guidance);
    let start = section(root, "start");
    start.clear();
    set(
        start,
        [
            ("position_w_m", numbers(&position)),
            ("yaw_deg", Value::Float(wrap_pi(gamma.z).to_degrees())),
            ("pitch_deg", Value::Float(gamma.y.to_degrees().clamp(-80.0, 80.0))),
            ("roll_deg", Value::Float(gamma.x.to_degrees())),
            ("morph_angle_deg", Value::Float(beta.rad().to_degrees().clamp(45.0, 160.0))),
            ("velocity_w_m_s", numbers(&sum(snapshot.velocity_w_m_s, draw.velocity_w_m_s))),
            ("body_rate_b_rad_s", numbers(&snapshot.body_rate_b_rad_s)),
            ("morph_rate_rad_s", Value::Float(snapshot.morph_rate_rad_s)),
            ("rotor_thrust_n", numbers(&thrusts)),
            ("error_position_w_m", numbers(&minus(draw.position_w_m))),
            ("error_velocity_w_m_s", numbers(&minus(draw.velocity_w_m_s))),
            ("error_attitude_b_rad", numbers(&minus(draw.attitude_b_rad))),
            ("at_s", Value::Float(plan_s)),
            ("plan_s", Value::Float(whole_s)),
            ("guidance", Value::Table(guidance)),
        ],
    );
}

fn guidance(guidance: &Guidance) -> Table {
    let mut all = Table::new();
    if let Some(way) = &guidance.position {
        let Way { begin_s, from_w_m, velocity_w_m_s, acceleration_w_m_s2, goal_w_m, .. } = way;
        let entries = table([
            ("begin_s", Value::Float(*begin_s)),
            ("from_w_m", numbers(from_w_m)),
            ("velocity_w_m_s", numbers(velocity_w_m_s)),
            ("acceleration_w_m_s2", numbers(acceleration_w_m_s2)),
            ("goal_w_m", numbers(goal_w_m)),
            ("brake_s", Value::Float(way.brake_s)),
            ("move_s", Value::Float(way.move_s)),
        ]);
        all.insert("position".to_owned(), Value::Table(entries));
    }
    for (name, turn) in [("yaw", &guidance.yaw), ("morph", &guidance.morph)] {
        let Some(Turn {
            begin_s,
            from_rad,
            rate_rad_s,
            acceleration_rad_s2,
            goal_rad,
            brake_s,
            move_s,
        }) = *turn
        else {
            continue;
        };
        let entries = table([
            ("begin_s", Value::Float(begin_s)),
            ("from_rad", Value::Float(from_rad)),
            ("rate_rad_s", Value::Float(rate_rad_s)),
            ("acceleration_rad_s2", Value::Float(acceleration_rad_s2)),
            ("goal_rad", Value::Float(goal_rad)),
            ("brake_s", Value::Float(brake_s)),
            ("move_s", Value::Float(move_s)),
        ]);
        all.insert(name.to_owned(), Value::Table(entries));
    }
    all
}

/// Writes out the defaults that the plan takes from the section `[start]`, because that section is replaced.
fn plan(root: &mut Table, flown: &Scenario) {
    let start = &flown.settings().start;
    let (position, yaw, morph) = (start.position_w_m, start.yaw_deg, start.morph_angle_deg);
    let is_hover = matches!(flown.settings().pilot.manoeuvre, Manoeuvre::Hover(_));
    let is_empty = flown.settings().pilot.common.morph.is_empty();
    let pilot = section(root, "pilot");
    if is_hover {
        pilot.entry("kind").or_insert_with(|| Value::String("hover".to_owned()));
        pilot.entry("position_w_m").or_insert_with(|| numbers(&position));
        pilot.entry("yaw_deg").or_insert_with(|| Value::Float(yaw));
    }
    if is_empty {
        let knot = numbers(&[0.0, morph]);
        pilot.insert("morph".to_owned(), Value::Array(vec![knot]));
    }
}

/// Initializes the estimator with the one-sigma errors of the snapshot.
fn believe(root: &mut Table, snapshot: &Snapshot) {
    let worst = |values: [f64; 3]| values.into_iter().fold(1e-6, f64::max);
    let sigma = |value: f64, most: f64| Value::Float(value.clamp(1e-6, most));
    set(
        section(root, "estimator"),
        [
            ("initial_position_sigma_m", sigma(worst(snapshot.position_sigma_w_m), 100.0)),
            ("initial_velocity_sigma_m_s", sigma(worst(snapshot.velocity_sigma_w_m_s), 100.0)),
            ("initial_attitude_sigma_rad", sigma(worst(snapshot.attitude_sigma_b_rad), 3.0)),
            ("initial_gyro_bias_sigma_rad_s", sigma(snapshot.gyro_bias_sigma_rad_s, 10.0)),
            (
                "initial_accelerometer_bias_sigma_m_s2",
                sigma(snapshot.accelerometer_bias_sigma_m_s2, 100.0),
            ),
        ],
    );
}

fn load(force_w_n: &[f64; 3], torque_b_nm: &[f64; 3]) -> Value {
    Value::Table(table([("force_w_n", numbers(force_w_n)), ("torque_b_nm", numbers(torque_b_nm))]))
}

/// Writes the script of the disturbance injector: the estimated load, and the challenges.
fn challenges(root: &mut Table, snapshot: &Snapshot, schedule: &Schedule) {
    let kind = |kind: &str| ("kind", Value::String(kind.to_owned()));
    let constant =
        table([kind("constant"), ("load", load(&snapshot.force_w_n, &snapshot.torque_b_nm))]);
    let mut script = vec![Value::Table(constant)];
    for trial in &schedule.trials {
        let at = ("at_s", Value::Float(trial.at_s));
        let event = match &trial.challenge {
            Challenge::Kick { body_rate_b_rad_s, .. } => {
                table([kind("kick"), at, ("body_rate_b_rad_s", numbers(body_rate_b_rad_s))])
            }
            Challenge::Push { force_w_n, for_s, .. } => table([
                kind("pulse"),
                at,
                ("duration_s", Value::Float(*for_s)),
                ("load", load(force_w_n, &[0.0; 3])),
            ]),
            Challenge::Gust { force_w_n, for_s } => table([
                kind("step"),
                at,
                ("until_s", Value::Float(trial.at_s + for_s)),
                ("load", load(force_w_n, &[0.0; 3])),
            ]),
            Challenge::Flip | Challenge::Step { .. } | Challenge::Sweep => continue,
        };
        script.push(Value::Table(event));
    }
    let injector = section(root, "disturbance_injector");
    injector.insert("script".to_owned(), Value::Array(script));
}

/// Writes the orders to the pilot: the step of the set point, and the sweeps.
fn orders(
    root: &mut Table,
    flown: &Scenario,
    snapshot: &Snapshot,
    schedule: &Schedule,
) -> Result<(), String> {
    let mut orders = Vec::new();
    for trial in &schedule.trials {
        let Challenge::Step { offset_w_m } = trial.challenge else { continue };
        let Plan::Flight(plan) = flown.plan() else { continue };
        let trajectory = Trajectory::new(&plan.trajectory).map_err(|error| error.to_string())?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let then_ns = facts::plan_ns(flown, snapshot) + (trial.at_s * 1e9) as u64;
        let order = guidance_order(&snapshot.guidance);
        let from = diversion::point(&trajectory, order.as_ref(), then_ns);
        let floor_m = if flown.settings().plant.ground { FLOOR_M } else { -1e9 };
        let mut goal: [f64; 3] = core::array::from_fn(|i| {
            (from.position_w_m[i] + offset_w_m[i]).clamp(-REACH_M, REACH_M)
        });
        goal[2] = goal[2].max(floor_m);
        let goto = table([("position_w_m", numbers(&goal))]);
        let entry = table([("at_s", Value::Float(trial.at_s)), ("goto", Value::Table(goto))]);
        orders.push(Value::Table(entry));
    }
    for sweep in &schedule.sweeps {
        let morph = table([
            ("angle_deg", Value::Float(sweep.angle_deg)),
            ("over_s", Value::Float(sweep.over_s)),
        ]);
        let entry = table([("at_s", Value::Float(sweep.at_s)), ("morph", Value::Table(morph))]);
        orders.push(Value::Table(entry));
    }
    if !orders.is_empty() {
        root.insert("order".to_owned(), Value::Array(orders));
    }
    Ok(())
}

/// The guidance order in a snapshot, if one is in effect.
fn guidance_order(known: &Guidance) -> Option<shared_types::GuidanceOrder> {
    let settings = toml::Value::Table(guidance(known)).try_into::<GuidanceSettings>().ok()?;
    settings.order()
}

/// Latest instant at which, in a flight with a trip, the position slot changes hands \[s\].
fn trip_from_s(facts: &Facts) -> f64 {
    flip_s(facts, Slot::Attitude) + flip_s(facts, Slot::Position)
}

/// A swap in which a controller joins at `at_s` \[s\] and takes over the slot, even if the admission check rejects it.
fn swap(slot: Slot, by: (&String, Option<&PathBuf>), at_s: f64, facts: &Facts) -> Value {
    let (to, config) = by;
    let mut entry = table([
        ("slot", Value::String(slot.label().to_owned())),
        ("to", Value::String(to.clone())),
        ("at_s", Value::Float(at_s)),
        ("shadow_s", Value::Float(shadow_s(facts, slot))),
        ("rollback_s", Value::Float(0.0)),
        ("force", Value::Boolean(true)),
        ("rehearse", Value::Boolean(false)),
    ]);
    if let Some(config) = config {
        entry.insert("config".to_owned(), Value::String(config.display().to_string()));
    }
    Value::Table(entry)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nominal_plant_has_no_initial_bias_and_nothing_scripted_of_any_sensor() {
        let text = "
            [plant.mismatch]
            mass_scale = 1.2
            [plant.imu]
            rate_hz = 500
            drop_outs = [{ from_s = 1.0, until_s = 2.0 }]
            bias_step = { at_s = 1.0 }
            [plant.pose_fix]
            drop_outs = [{ from_s = 1.0, until_s = 2.0 }]
            [plant.barometer]
            rate_hz = 50
            drop_outs = [{ from_s = 1.0, until_s = 2.0 }]
            [plant.range_finder]
            drop_outs = [{ from_s = 1.0, until_s = 2.0 }]
        ";
        let mut root: Table = toml::from_str(text).unwrap();
        nominal(&mut root);
        let wanted = "
            [plant.imu]
            rate_hz = 500
            gyro_initial_bias_rad_s = 0.0
            accelerometer_initial_bias_m_s2 = 0.0
            [plant.pose_fix]
            [plant.barometer]
            rate_hz = 50
            initial_bias_m = 0.0
            [plant.range_finder]
        ";
        assert_eq!(root, toml::from_str(wanted).unwrap());
    }
}
