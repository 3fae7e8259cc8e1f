//! Follows the roll and pitch torque that the plant applies: how much of it has passed the lag of the rotors, and for how
//! long it has been full, that is as much as the laws of the attitude slot ask for.

use shared_types::{AppliedCommand, GateMode};
use vehicle::{MorphAngle, VehicleParameters};

/// Share of the bound on a torque from which it counts as full: allocation and the noise of β take a little.
const FULL_SHARE: f64 = 0.9;
/// Least thrust, in weights, by which the bound is computed. Without thrust there is no torque, however full.
const MIN_WEIGHTS: f64 = 0.3;
/// Longest time between two samples of one full torque \[ns\]; what was applied meanwhile is not known.
const MAX_GAP_NS: u64 = 20_000_000;

shared_types::memory! {
    /// State of [`Torque`].
    #[derive(PartialEq)]
    pub struct TorqueMemory {
        /// Roll and pitch torque of the last sample \[N m\].
        pub torque_nm: [f64; 2],
        /// The same behind the lag of the rotors \[N m\].
        pub lagged_nm: [f64; 2],
        /// Since when each has been full to one side without a break \[ns\]; 0 if it is not.
        pub full_from_ns: [u64; 2],
        /// By how many commands in a row.
        pub commands: [u64; 2],
        /// Sequence of the command of the last sample.
        pub command_sequence: u64,
        /// Instant of the last sample \[ns\].
        pub at_ns: u64,
    }
}

/// Follows roll and pitch torque from one sample of the plant to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Torque {
    vehicle: VehicleParameters,
    /// Whether a law of the slot asks for no more than its bound.
    is_bounded: bool,
    memory: TorqueMemory,
}

impl Torque {
    pub(crate) fn new(vehicle: &VehicleParameters, is_bounded: bool) -> Self {
        Self { vehicle: *vehicle, is_bounded, memory: TorqueMemory::default() }
    }

    /// Takes what the plant applies from the instant of the sample on. Only what the controller in command has asked for
    /// counts as full.
    pub(crate) fn take(&mut self, applied: &AppliedCommand, beta: MorphAngle) {
        let now_ns = applied.header.release_ns;
        let thrust_n = applied.thrust_n.max(MIN_WEIGHTS * self.vehicle.weight_n());
        let bound_nm = self.vehicle.torque_bound_nm(beta, thrust_n);
        let is_commanded = self.is_bounded
            && applied.mode == GateMode::Normal
            && applied.command_sequence > 0
            && applied.command_seat == applied.seat;
        let memory = &mut self.memory;
        let elapsed_ns = now_ns.saturating_sub(memory.at_ns);
        let share = -libm::expm1(-1e-9 * elapsed_ns as f64 / self.vehicle.rotor_lag_s);
        for axis in 0..2 {
            let (before_nm, lagged_nm) = (memory.torque_nm[axis], memory.lagged_nm[axis]);
            memory.lagged_nm[axis] = lagged_nm + share * (before_nm - lagged_nm);
            let torque_nm = Some(applied.torque_b_nm[axis]).filter(|torque| torque.is_finite());
            let torque_nm = torque_nm.unwrap_or(0.0);
            let is_full = is_commanded && torque_nm.abs() >= FULL_SHARE * bound_nm[axis];
            let goes_on = memory.full_from_ns[axis] > 0
                && before_nm * torque_nm > 0.0
                && elapsed_ns <= MAX_GAP_NS;
            if !is_full {
                (memory.full_from_ns[axis], memory.commands[axis]) = (0, 0);
            } else if !goes_on {
                (memory.full_from_ns[axis], memory.commands[axis]) = (now_ns, 1);
            } else {
                let is_another = applied.command_sequence != memory.command_sequence;
                memory.commands[axis] += u64::from(is_another);
            }
            memory.torque_nm[axis] = torque_nm;
        }
        (memory.at_ns, memory.command_sequence) = (now_ns, applied.command_sequence);
    }

    /// How long each torque had been full at the last sample \[s\], with the sign of the torque; 0 if it is not, or by one
    /// command alone, which may be held because the next one is late.
    pub(crate) fn full_s(&self) -> [f64; 2] {
        let TorqueMemory { torque_nm, full_from_ns, commands, at_ns, .. } = self.memory;
        [0, 1].map(|axis| {
            if commands[axis] < 2 {
                return 0.0;
            }
            (at_ns.saturating_sub(full_from_ns[axis]) as f64 * 1e-9).copysign(torque_nm[axis])
        })
    }

    /// Torque behind the lag at the last sample \[N m\].
    pub(crate) fn lagged_nm(&self) -> [f64; 2] {
        self.memory.lagged_nm
    }

    /// Forgets for how long torques have been full, since a new owner has not given them.
    pub(crate) fn forget(&mut self) {
        (self.memory.full_from_ns, self.memory.commands) = ([0; 2], [0; 2]);
    }

    pub(crate) fn memory(&self) -> TorqueMemory {
        self.memory
    }

    pub(crate) fn restore(&mut self, memory: &TorqueMemory) {
        self.memory = *memory;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Header;

    const MS: u64 = 1_000_000;

    /// At a millisecond, by the second command from the 10th on.
    fn applied(ms: u64, roll_nm: f64) -> AppliedCommand {
        AppliedCommand {
            header: Header { release_ns: ms * MS, ..Header::default() },
            command_sequence: 1 + ms / 10,
            thrust_n: VehicleParameters::default().weight_n(),
            torque_b_nm: [roll_nm, 0.0, 0.0],
            mode: GateMode::Normal,
            ..AppliedCommand::default()
        }
    }

    /// Largest torque about roll, and how long it is full after samples at 8, 9, 10 and 11 ms.
    fn full_s(is_bounded: bool, made: impl Fn(AppliedCommand) -> AppliedCommand) -> f64 {
        let vehicle = VehicleParameters::default();
        let full_nm = vehicle.torque_bound_nm(MorphAngle::MIN, vehicle.weight_n()).x;
        let mut torque = Torque::new(&vehicle, is_bounded);
        for ms in 8..=11 {
            torque.take(&made(applied(ms, full_nm)), MorphAngle::MIN);
        }
        torque.full_s()[0]
    }

    fn turned(applied: AppliedCommand, share: f64) -> AppliedCommand {
        let [roll_nm, pitch_nm, yaw_nm] = applied.torque_b_nm;
        AppliedCommand { torque_b_nm: [share * roll_nm, pitch_nm, yaw_nm], ..applied }
    }

    #[test]
    fn a_torque_is_full_from_its_first_sample_on_once_a_second_command_is() {
        assert!((full_s(true, |applied| applied) - 0.003).abs() < 1e-12);
        assert!((full_s(true, |applied| turned(applied, -1.0)) + 0.003).abs() < 1e-12);
        let is_none =
            |made: &dyn Fn(AppliedCommand) -> AppliedCommand| full_s(true, made).abs() < 1e-12;
        assert!(full_s(false, |applied| applied).abs() < 1e-12, "its law may ask for more");
        assert!(is_none(&|applied| turned(applied, 0.8)));
        assert!(
            is_none(&|applied| AppliedCommand { command_sequence: 1, ..applied }),
            "one is held"
        );
        assert!(is_none(&|applied| AppliedCommand { seat: 1, ..applied }), "another owner's");
        assert!(is_none(&|applied| AppliedCommand { mode: GateMode::Level, ..applied }));
        let weak = |applied| AppliedCommand { thrust_n: 0.0, ..turned(applied, 1e-6) };
        assert!(is_none(&weak), "without thrust no torque is full");
    }

    #[test]
    fn what_is_full_begins_anew_on_the_other_side_and_after_a_gap() {
        let vehicle = VehicleParameters::default();
        let full_nm = vehicle.torque_bound_nm(MorphAngle::MIN, vehicle.weight_n()).x;
        let mut torque = Torque::new(&vehicle, true);
        let mut full_s = |ms: u64, roll_nm: f64| {
            torque.take(&applied(ms, roll_nm), MorphAngle::MIN);
            torque.full_s()[0]
        };
        full_s(9, -full_nm);
        assert!((full_s(10, -full_nm) + 0.001).abs() < 1e-12);
        full_s(19, full_nm);
        assert!((full_s(20, full_nm) - 0.001).abs() < 1e-12);
        full_s(59, full_nm);
        assert!((full_s(60, full_nm) - 0.001).abs() < 1e-12);
        assert!(full_s(61, f64::NAN).abs() < 1e-12);
        full_s(62, full_nm);
        assert!(torque.lagged_nm()[0].is_finite());
    }

    #[test]
    fn behind_the_lag_the_torque_is_the_closed_form_of_its_step() {
        let vehicle = VehicleParameters::default();
        let mut torque = Torque::new(&vehicle, true);
        for ms in 1..=20 {
            torque.take(&applied(ms, 0.01), MorphAngle::MIN);
        }
        let expected_nm = -0.01 * libm::expm1(-0.019 / vehicle.rotor_lag_s);
        assert!((torque.lagged_nm()[0] - expected_nm).abs() < 1e-15);
    }
}
