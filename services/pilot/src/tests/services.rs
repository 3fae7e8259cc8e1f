//! What is published, and that it survives a restart.

use super::{MS, along_path, distance, figure, shapes, sweeps, vehicle, waypoints};
use crate::{
    AttitudeStep, Pilot, PilotConfig, PilotError, PilotInputs, PilotOutputs, RigPilot,
    RigPilotConfig, RigPilotOutputs, TrajectoryConfig,
};
use runtime::Layout;
use runtime::service::{pack_state, unpack_state};
use runtime::{OutputSet, Service, StateHeader};
use shared_types::{Header, MorphCommand, Reference};
use vehicle::VehicleParameters;

const SPACING_NS: u64 = 50 * MS;
const MORPH_SPACING_NS: u64 = 20 * MS;

fn plan(trajectory: TrajectoryConfig) -> PilotConfig {
    PilotConfig { morph: sweeps(), ..PilotConfig::new(trajectory) }
}

fn published(pilot: &mut Pilot, now_ns: u64) -> (Reference, MorphCommand) {
    let mut outputs = PilotOutputs::default();
    pilot.step(now_ns, &PilotInputs::default(), &mut outputs);
    let reference = outputs.reference.written().copied();
    (reference.unwrap_or_default(), outputs.morph_command.written().copied().unwrap_or_default())
}

#[test]
fn what_a_preview_shows_is_later_published_bit_for_bit() {
    for config in shapes() {
        let mut pilot = Pilot::new(&plan(config), &vehicle()).unwrap();
        for now_ns in (0..20_000 * MS).step_by(371_234_567) {
            let (early, early_morph) = published(&mut pilot, now_ns);
            assert_eq!((early.count, early.spacing_ns), (48, SPACING_NS));
            assert_eq!((early_morph.count, early_morph.spacing_ns), (48, MORPH_SPACING_NS));
            assert_eq!(early_morph.angle_rad.to_bits(), early_morph.path_rad[0].to_bits());
            for i in 0..48 {
                let (late, _) = published(&mut pilot, now_ns + i as u64 * SPACING_NS);
                let (_, late_morph) = published(&mut pilot, now_ns + i as u64 * MORPH_SPACING_NS);
                let bits = |p: &shared_types::ReferencePoint| {
                    (
                        p.position_w_m.map(f64::to_bits),
                        p.velocity_w_m_s.map(f64::to_bits),
                        p.yaw_rad.to_bits(),
                    )
                };
                assert_eq!(bits(&early.points[i]), bits(&late.points[0]));
                assert_eq!(early_morph.path_rad[i].to_bits(), late_morph.angle_rad.to_bits());
            }
        }
    }
}

#[test]
fn a_spacing_of_zero_or_of_minutes_is_refused() {
    for spacing_ns in [0, 60_000 * MS] {
        let config = PilotConfig { spacing_ns, ..plan(waypoints()) };
        assert!(matches!(Pilot::new(&config, &vehicle()), Err(PilotError::OutOfRange { .. })));
    }
}

#[test]
fn a_rig_pilot_steps_the_attitude_at_its_instant_and_carries_the_weight() {
    let step = AttitudeStep { at_s: 0.3, roll_rad: 0.2, pitch_rad: -0.1, yaw_rad: 0.05 };
    let config = RigPilotConfig { step, morph: sweeps(), ..RigPilotConfig::default() };
    let mut pilot = RigPilot::new(&config, &vehicle()).unwrap();
    let mut outputs = RigPilotOutputs::default();
    let cases = [
        (0, [0.0; 3]),
        (300 * MS - 1, [0.0; 3]),
        (300 * MS, [0.2, -0.1, 0.05]),
        (9000 * MS, [0.2, -0.1, 0.05]),
    ];
    for (now_ns, angles) in cases {
        pilot.step(now_ns, &PilotInputs::default(), &mut outputs);
        let setpoint = outputs.attitude_setpoint.written().unwrap();
        let published = [setpoint.roll_rad, setpoint.pitch_rad, setpoint.yaw_rad];
        assert!(distance(published, angles) < 1e-15, "{now_ns}");
        assert!((setpoint.thrust_n - 0.12 * 9.81).abs() < 1e-15);
        let morph = outputs.morph_command.written().unwrap();
        assert_eq!(
            morph.path_rad[5].to_bits(),
            pilot.morph().angle_rad(now_ns + 100 * MS).to_bits()
        );
    }
}

#[test]
fn bad_attitude_steps_are_refused() {
    let good = AttitudeStep { at_s: 0.3, roll_rad: 0.2, pitch_rad: 0.2, yaw_rad: 0.2 };
    let bad = [
        AttitudeStep { at_s: f64::NAN, ..good },
        AttitudeStep { at_s: -1.0, ..good },
        AttitudeStep { roll_rad: f64::NAN, ..good },
        AttitudeStep { pitch_rad: 1.3, ..good },
        AttitudeStep { yaw_rad: f64::NEG_INFINITY, ..good },
    ];
    for step in bad {
        let config = RigPilotConfig { step, ..RigPilotConfig::default() };
        assert!(matches!(RigPilot::new(&config, &vehicle()), Err(PilotError::OutOfRange { .. })));
    }
    let heavy = VehicleParameters { mass_kg: f64::NAN, ..vehicle() };
    assert!(RigPilot::new(&RigPilotConfig::default(), &heavy).is_err());
}

#[test]
fn a_restored_pilot_continues_bit_for_bit() {
    let build = || Pilot::new(&plan(figure(along_path())), &vehicle()).unwrap();
    let run = |pilot: &mut Pilot, outputs: &mut PilotOutputs, from: u64, to: u64| {
        let mut bytes = Vec::new();
        for k in from..to {
            pilot.step(k * SPACING_NS, &PilotInputs::default(), outputs);
            outputs.flush(&Header { release_ns: k * SPACING_NS, ..Header::default() });
            let mut state = vec![0; Layout::of::<Pilot>().state_size()];
            let header =
                StateHeader { layout_hash: Layout::of::<Pilot>().hash(), ..StateHeader::default() };
            pack_state(pilot, &header, &PilotInputs::default(), outputs, &mut state);
            bytes.push(state);
        }
        bytes
    };
    let (mut first, mut first_outputs) = (build(), PilotOutputs::default());
    let before = run(&mut first, &mut first_outputs, 0, 100);
    let expected = run(&mut first, &mut first_outputs, 100, 200);

    let (mut second, mut second_outputs) = (build(), PilotOutputs::default());
    let state = before.last().unwrap();
    unpack_state(&mut second, &mut PilotInputs::default(), &mut second_outputs, state).unwrap();
    assert_eq!(run(&mut second, &mut second_outputs, 100, 200), expected);
    assert_eq!(second.memory().steps, 200);
    let (a, b) = (published(&mut first, 7 * MS), published(&mut second, 7 * MS));
    let bits = |reference: Reference| reference.points.map(|p| p.position_w_m.map(f64::to_bits));
    assert_eq!(bits(a.0), bits(b.0));
}

#[test]
fn a_step_allocates_nothing() {
    let mut pilot = Pilot::new(&plan(figure(along_path())), &vehicle()).unwrap();
    let mut by_waypoints = Pilot::new(&plan(waypoints()), &vehicle()).unwrap();
    let mut rig = RigPilot::new(&RigPilotConfig::default(), &vehicle()).unwrap();
    let inputs = PilotInputs::default();
    let (mut outputs, mut rig_outputs) = (PilotOutputs::default(), RigPilotOutputs::default());
    let count = allocation_counter::measure(|| {
        for k in 0..100 {
            pilot.step(k * SPACING_NS, &inputs, &mut outputs);
            by_waypoints.step(k * SPACING_NS, &inputs, &mut outputs);
            rig.step(k * SPACING_NS, &inputs, &mut rig_outputs);
        }
    });
    assert_eq!(count.count_total, 0);
}
