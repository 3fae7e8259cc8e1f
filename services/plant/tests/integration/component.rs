//! The plant between its ports: instants, ownership, garbage, and continuing from a memory.

use nalgebra::Vector3;
use plant::gate::GateConfig;
use plant::ports::{Inputs, Outputs};
use plant::sensors::SensorConfigs;
use plant::{ModelKind, Motion, Plant, PlantConfig};
use runtime::graph::Edge;
use runtime::{InputSet as _, Service as _, Source};
use shared_types::{Header, NO_SEAT, OwnerRecord, Role, Sample, TopicInfo, WrenchCommand, topics};
use std::collections::VecDeque;
use vehicle::{MorphAngle, VehicleParameters};

const OWNER: u32 = 1;
const SHADOW: u32 = 2;
const STRAY: u32 = 3;

struct Queue<T>(VecDeque<T>);

impl<T> Source<T> for Queue<T> {
    fn receive(&mut self) -> Option<T> {
        self.0.pop_front()
    }
}

fn at<T: Sample>(mut sample: T, sequence: u64, valid_ns: u64, seat: u32) -> T {
    *sample.header_mut() =
        Header { sequence, release_ns: valid_ns, valid_ns, seat, ..Header::default() };
    sample
}

fn command(torque_x_nm: f64) -> WrenchCommand {
    let weight_n = VehicleParameters::default().weight_n();
    WrenchCommand {
        thrust_n: weight_n,
        torque_b_nm: [torque_x_nm, 0.0, 0.0],
        validity_ns: 20_000_000,
        ..WrenchCommand::default()
    }
}

fn plant(model: ModelKind) -> Plant {
    Plant::new(&PlantConfig {
        vehicle: VehicleParameters::default(),
        model,
        sensors: SensorConfigs::default(),
        gate: GateConfig::default(),
        unproven: None,
        position_w_m: Vector3::new(0.0, 0.0, 1.5),
        yaw_rad: 0.0,
        morph_angle: MorphAngle::MIN,
        motion: Motion::default(),
        seed: 1,
    })
    .expect("the default plant is possible")
}

fn inputs(commands: Vec<WrenchCommand>) -> Inputs {
    let mut inputs = Inputs::default();
    let owner = OwnerRecord {
        epoch: 1,
        period_ns: [0, 10_000_000, 10_000_000, 0],
        owner: OWNER,
        fallback: NO_SEAT,
        ..OwnerRecord::default()
    };
    let edge = |topic: &'static TopicInfo| Some(Edge::unwaited(topic, Role::Plant));
    let owners = Queue([at(owner, 1, 0, 0)].into());
    inputs.attitude_owner.connect(Box::new(owners), edge(&topics::ATTITUDE_OWNER.info));
    let commands = Queue(commands.into());
    inputs.wrench_command.connect(Box::new(commands), edge(&topics::WRENCH_COMMAND.info));
    inputs.receive();
    inputs
}

/// Steps from one millisecond to another, both included; the outputs of the last step.
fn fly(plant: &mut Plant, inputs: &mut Inputs, from_ms: u64, until_ms: u64) -> Outputs {
    let mut outputs = Outputs::default();
    for t_ms in from_ms..=until_ms {
        let previous = t_ms.checked_sub(1).map(|t| t * 1_000_000);
        inputs.accept(t_ms * 1_000_000, previous);
        plant.step(t_ms * 1_000_000, inputs, &mut outputs);
    }
    outputs
}

#[test]
fn a_command_takes_effect_at_its_instant_and_not_at_the_next_tick() {
    let (torque_nm, start_ns) = (0.01, 2_300_000);
    let mut plant = plant(ModelKind::Linear);
    let mut inputs = inputs(vec![at(command(torque_nm), 1, start_ns, OWNER)]);
    let outputs = fly(&mut plant, &mut inputs, 0, 5);
    // ω = τ / I · t from the instant on, exact on the linear vehicle; R₂ is 1 to 1e-9 here.
    let inertia = VehicleParameters::default().inertia_kg_m2(MorphAngle::MIN).x;
    let rate = outputs.truth.written().unwrap().body_rate_b_rad_s[0];
    assert!((rate - torque_nm / inertia * 2.7e-3).abs() < 1e-9, "{rate}");
    assert_eq!(outputs.applied_command.written().unwrap().command_sequence, 1);
}

#[test]
fn only_the_owner_moves_a_rotor_and_writers_without_a_seat_are_counted() {
    let commands = vec![
        at(command(0.01), 1, 1_000_000, SHADOW),
        at(command(f64::NAN), 2, 2_000_000, SHADOW),
        at(command(0.02), 1, 2_000_000, STRAY),
        at(command(f64::NAN), 2, 3_000_000, STRAY),
    ];
    let mut plant = plant(ModelKind::Nonlinear { ground: false });
    let outputs = fly(&mut plant, &mut inputs(commands), 0, 10);
    let applied = outputs.applied_command.written().unwrap();
    assert_eq!((applied.refused_wrong_owner, applied.command_sequence), (2, 0));
    assert_eq!(applied.refused_not_finite, 0);
    assert!(applied.torque_b_nm.iter().all(|t| t.abs() < 1e-12));
}

#[test]
fn garbage_never_reaches_a_rotor_and_is_counted() {
    let mut commands = Vec::new();
    for (k, value) in (1..).zip([f64::NAN, f64::INFINITY, -1e300, 50.0]) {
        commands.push(at(command(value), k, k * 1_000_000, OWNER));
    }
    let mut plant = plant(ModelKind::Nonlinear { ground: false });
    let outputs = fly(&mut plant, &mut inputs(commands), 0, 10);
    let applied = outputs.applied_command.written().unwrap();
    assert_eq!((applied.refused_not_finite, applied.refused_out_of_range), (2, 2));
    let limit_n = VehicleParameters::default().rotor_thrust_max_n;
    assert!(applied.rotor_thrust_n.iter().all(|f| (0.0..=limit_n).contains(f)));
}

#[test]
fn a_plant_restored_in_flight_continues_bit_for_bit() {
    let commands: Vec<_> =
        (0..10).map(|k| at(command(0.002), k + 1, k * 10_000_000 + 500_000, OWNER)).collect();
    let model = ModelKind::Nonlinear { ground: true };
    let (mut first, mut second) = (plant(model), plant(model));
    let mut first_inputs = inputs(commands.clone());
    fly(&mut first, &mut first_inputs, 0, 47);
    second.restore(&first.memory()).unwrap();
    // The successor has the latches of the first, and what is pending comes again.
    let mut second_inputs = inputs(commands);
    second_inputs.accept(47_000_000, None);
    let first = fly(&mut first, &mut first_inputs, 48, 90);
    let second = fly(&mut second, &mut second_inputs, 48, 90);
    let shown =
        |outputs: &Outputs| format!("{:?} {:?}", outputs.truth.written(), outputs.imu.written());
    assert!(first.truth.written().is_some());
    assert_eq!(shown(&first), shown(&second));
}
