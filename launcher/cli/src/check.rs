//! `morphquad check`: what a scenario would fly.

use attitude_mpc::settings::Settings;
use disturbance_injector::Event;
use host::realtime::may_lock_memory;
use monitor::Limits;
use monitor::settings::Fallback;
use runtime::{Graph, MissPolicy, Node};
use scenario::needs::MemoryNeed;
use scenario::services::{self, Assignment};
use scenario::settings::{Clock, FaultSettings, ScenarioSettings, StandbySettings, SwapSettings};
use scenario::{self, Scenario, needs};
use serde_json::json;
use shared_types::Role;
use std::io::{self, Write};

/// Prints the scenario and, since it has been loaded, `ok`.
///
/// # Errors
/// Those of `out`.
pub fn print(scenario: &Scenario, out: &mut dyn Write) -> io::Result<()> {
    let graph = scenario.graph().map_err(io::Error::other)?;
    summary(scenario, out)?;
    loops(scenario, &graph, out)?;
    arrows(&graph, &scenario.settings().scenario, out)?;
    world(scenario, out)?;
    writeln!(out, "ok")
}

/// Prints loops, edges and the whole scenario as one object.
///
/// # Errors
/// Those of `out`.
pub fn print_json(scenario: &Scenario, out: &mut dyn Write) -> io::Result<()> {
    let graph = scenario.graph().map_err(io::Error::other)?;
    let assignment = Assignment::of(scenario.settings());
    let whole: toml::Table = scenario.to_complete_toml().parse().map_err(io::Error::other)?;
    let loops = graph.nodes().iter().map(|node| {
        json!({
            "loop": node.role.label(),
            "flown_by": assignment.name(node.role),
            "rate_hz": node.rate.hz(),
            "lead_ns": node.lead_ns,
            "missed": missed(node),
        })
    });
    let edges = graph.edges().iter().map(|edge| {
        json!({
            "topic": edge.topic.name,
            "from": edge.from.label(),
            "to": edge.to.label(),
            "asap": edge.asap,
            "latency_ns": edge.latency_ns,
            "waited_for_ns": edge.deadline_ns,
            "deadline_ns": edge.latency_ns + edge.deadline_ns,
        })
    });
    let warnings: Vec<String> = scenario.warnings().iter().map(ToString::to_string).collect();
    let object = json!({
        "loops": loops.collect::<Vec<_>>(),
        "edges": edges.collect::<Vec<_>>(),
        "warnings": warnings,
        "scenario": whole,
    });
    writeln!(out, "{object}")
}

fn summary(scenario: &Scenario, out: &mut dyn Write) -> io::Result<()> {
    let settings = &scenario.settings().scenario;
    let clock = match settings.clock {
        Clock::Lockstep => "lockstep",
        Clock::Realtime => "realtime",
    };
    let speed = settings.pace().map_or("max".to_owned(), |factor| format!("{factor}x"));
    match settings.description.as_str() {
        "" => writeln!(out, "{}", settings.name)?,
        description => writeln!(out, "{}: {description}", settings.name)?,
    }
    writeln!(
        out,
        "clock {clock}, speed {speed}, {} s, seed {}\n",
        settings.duration_s, settings.seed
    )
}

fn loops(scenario: &Scenario, graph: &Graph, out: &mut dyn Write) -> io::Result<()> {
    let assignment = Assignment::of(scenario.settings());
    writeln!(
        out,
        "{:<14}{:<22}{:>10}{:>14}{:>14}  MISSED",
        "LOOP", "FLOWN BY", "RATE", "PERIOD", "LEAD"
    )?;
    for node in graph.nodes() {
        writeln!(
            out,
            "{:<14}{:<22}{:>10}{:>14}{:>14}  {}",
            node.role.label(),
            assignment.name(node.role),
            format!("{} Hz", node.rate.hz()),
            milliseconds(node.rate.period_ns()),
            milliseconds(node.lead_ns),
            missed(node)
        )?;
    }
    writeln!(out, "Others can fill a slot: --controller {}.\n", services::fillings().join(" or "))
}

fn missed(node: &Node) -> &'static str {
    match node.miss_policy {
        MissPolicy::Skip => "skip",
        MissPolicy::CatchUp => "catch up",
        MissPolicy::Hold => "hold",
    }
}

/// One line per edge: from which instant a sample counts, how long the step that needs it waits, and
/// when it is late, all after the release of its producer, in logical time.
fn arrows(graph: &Graph, flown: &ScenarioSettings, out: &mut dyn Write) -> io::Result<()> {
    let times = flown.pace().filter(|_| flown.clock == Clock::Realtime);
    let wall = times.map_or(String::new(), |times| format!("AT {times}x"));
    writeln!(
        out,
        "{:<20}{:<14}{:<14}{:>10}{:>12}{:>12}{wall:>14}",
        "TOPIC", "FROM", "TO", "LATENCY", "WAITED FOR", "DEADLINE"
    )?;
    for edge in graph.edges() {
        let deadline_ns = edge.latency_ns + edge.deadline_ns;
        let on_wall = |times: f64| format!("{} ms", (deadline_ns as f64 / times).round() / 1e6);
        writeln!(
            out,
            "{:<20}{:<14}{:<14}{:>10}{:>12}{:>12}{:>14}",
            edge.topic.name,
            edge.from.label(),
            edge.to.label(),
            if edge.asap { "asap".to_owned() } else { milliseconds(edge.latency_ns) },
            milliseconds(edge.deadline_ns),
            format!("{} ms", deadline_ns as f64 / 1e6),
            times.map_or(String::new(), on_wall),
        )?;
    }
    writeln!(
        out,
        "A sample takes effect a latency after its release and is late if it comes after its\n\
         deadline, which counts from its release too. In lockstep nothing is ever late.\n"
    )
}

fn world(scenario: &Scenario, out: &mut dyn Write) -> io::Result<()> {
    let settings = scenario.settings();
    let manoeuvre = settings.pilot.manoeuvre.describe();
    let given = scenario.trajectory().filter(|path| path.pieces().is_some());
    match given.as_ref().and_then(|path| Some((path, path.pieces()?, path.rest_s()?))) {
        Some((path, pieces, rest_s)) => {
            let always_ns = [0, u64::MAX];
            let speed_m_s = path.peak_speed_m_s(always_ns);
            let acceleration_m_s2 = path.peak_acceleration_m_s2(always_ns);
            let pieces =
                if pieces == 1 { "1 piece".to_owned() } else { format!("{pieces} pieces") };
            writeln!(
                out,
                "flight  {manoeuvre} of {pieces}, at rest from {rest_s:.3} s on, \
                 up to {speed_m_s:.2} m/s and {acceleration_m_s2:.2} m/s^2"
            )?;
        }
        None => writeln!(out, "flight  {manoeuvre}")?,
    }
    let MemoryNeed { shared_mb, own_mb } = MemoryNeed::of_flight(settings, may_lock_memory());
    let files = needs::DESCRIPTORS;
    writeln!(
        out,
        "needs   {shared_mb} MB of shared memory and {own_mb} MB beside it, {files} file descriptors, {} processes and threads; \
         `morphquad doctor` shows whether they can be had here",
        needs::TASKS
    )?;
    if Assignment::of(settings).name(Role::Attitude) == "attitude-mpc" {
        let law = scenario.attitude_law().map_err(io::Error::other)?;
        let look_ahead_s = Settings::look_ahead_s(&law).map_err(io::Error::other)?;
        writeln!(
            out,
            "law     attitude looks {look_ahead_s:.3} s ahead in {:.0} samples, solver {:?}",
            look_ahead_s * law.rate_hz,
            law.solver
        )?;
    }
    let knots = settings.pilot.common.morph.iter();
    let path: Vec<String> =
        knots.map(|[t_s, angle_deg]| format!("{angle_deg} deg at {t_s} s")).collect();
    if path.is_empty() {
        writeln!(out, "morph   {} deg throughout", settings.start.morph_angle_deg)?;
    } else {
        writeln!(out, "morph   {}", path.join(", "))?;
    }
    let script = &settings.disturbance_injector.script;
    for event in script {
        match event {
            Event::Wind(wind) => writeln!(
                out,
                "wind    mean {:?} m/s, sigma {:?} m/s",
                wind.mean_w_m_s, wind.sigma_m_s
            )?,
            other => writeln!(out, "event   {other:?}")?,
        }
    }
    if script.is_empty() {
        writeln!(out, "wind    none")?;
    }
    monitor(scenario, out)?;
    script_of(scenario, out)
}

/// Beyond what a new owner trips.
fn monitor(scenario: &Scenario, out: &mut dyn Write) -> io::Result<()> {
    let settings = scenario.settings();
    if !settings.monitor.enabled {
        return writeln!(out, "monitor off: an owner that loses the vehicle keeps the slot");
    }
    let limits = settings.monitor_limits();
    let Limits { turn_away_rad, tilt_rad, heading_rad, astray_rad, astray_s, .. } = limits;
    let Limits { swing_rate_rad_s, swing_tilt_rad, setpoint_tilt_rad, clipped_s, .. } = limits;
    let [least, most] = limits.setpoint_thrust_weights;
    let Limits { thrust_speed_m_s, excursion_m, off_course_m, off_course_s, height_m, .. } = limits;
    let standby = match settings.monitor.fallback {
        Fallback::Auto => "the owner before it",
        Fallback::None => "none, so that the vehicle is held without one,",
    };
    let bounded = scenario.keeps_to_rotors();
    let full_torque = if bounded { "turns beyond its set point at full torque, " } else { "" };
    let gate = &settings.plant.gate;
    writeln!(
        out,
        "monitor a new owner trips, and {standby} follows, when the vehicle can be stopped only beyond\n\
         \x20       {turn_away_rad:.3} rad away from its set point, {tilt_rad:.3} rad of tilt, {heading_rad:.3} rad of heading,\n\
         \x20       {excursion_m} m away from its reference, {height_m} m above the ground, or when it is\n\
         \x20       {astray_rad:.3} rad off for {astray_s} s or {off_course_m} m for {off_course_s} s, swings by {swing_rate_rad_s} rad/s or is swung by {swing_tilt_rad:.3} rad,\n\
         \x20       asks for {setpoint_tilt_rad:.3} rad of tilt, for less thrust than {least} weights or more than {most},\n\
         \x20       or for a heading {heading_rad:.3} rad off the reference, reports of the position slot what is not so,\n\
         \x20       {full_torque}clips the rotors for {clipped_s} s, or gains {thrust_speed_m_s} m/s by another thrust than asked for;\n\
         \x20       beyond {} rad or {} rad/s the gate levels first, to {} rad and {} rad/s",
        gate.recover_tilt_rad,
        gate.recover_rate_rad_s,
        gate.recovered_tilt_rad,
        gate.recovered_rate_rad_s
    )
}

/// What is done to the flight on purpose.
fn script_of(scenario: &Scenario, out: &mut dyn Write) -> io::Result<()> {
    let settings = scenario.settings();
    for swap in &settings.swap {
        let SwapSettings { slot, to, at_s, shadow_s, rollback_s, max_bump, config, .. } = swap;
        let config =
            config.as_ref().map_or(String::new(), |c| format!(", as {} sets it", c.display()));
        let bump = max_bump.map_or(String::new(), |bump| format!(", bump at most {bump}"));
        let rehearsal = match swap.rehearse {
            Some(true) => ", rehearsed",
            Some(false) => ", not rehearsed",
            None => "",
        };
        let force = if swap.force { ", whatever gate and rehearsal decide" } else { "" };
        let slot = slot.label();
        writeln!(
            out,
            "swap    {slot} to {to} at {at_s} s, shadow {shadow_s} s, rollback {rollback_s} s{bump}{rehearsal}{force}{config}"
        )?;
    }
    for StandbySettings { slot, name, at_s, shadow_s, .. } in &settings.standby {
        let slot = slot.label();
        writeln!(out, "standby {slot} {name} from {at_s} s, shadow {shadow_s} s")?;
    }
    for FaultSettings { kind, name, at_s } in &settings.fault {
        writeln!(out, "fault   {} {name} at {at_s} s", kind.label())?;
    }
    if let Some(script) = scenario.timing() {
        for (_, entry) in script.announced() {
            writeln!(out, "timing  {entry}")?;
        }
    }
    for settings in &settings.order {
        if let Some(order) = settings.order() {
            writeln!(out, "order   {order} at {} s", settings.at_s)?;
        }
    }
    Ok(())
}

fn milliseconds(ns: u64) -> String {
    if ns == 0 { "-".to_owned() } else { format!("{} ms", ns as f64 / 1e6) }
}
