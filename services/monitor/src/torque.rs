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
        /// Instant of the last sample \[ns\].
        pub at_ns: u64,
    }
}

/// Follows roll and pitch torque from one sample of the plant to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Torque {
    lag_s: f64,
    /// Whether a law of the slot asks for no more than its bound.
    is_bounded: bool,
    memory: TorqueMemory,
}

impl Torque {
    pub(crate) fn new(vehicle: &VehicleParameters, is_bounded: bool) -> Self {
        Self { lag_s: vehicle.rotor_lag_s, is_bounded, memory: TorqueMemory::default() }
    }

    /// Takes what the plant applies from the instant of the sample on. Only what the controller in command has asked for
    /// counts as full.
    pub(crate) fn take(
        &mut self,
        applied: &AppliedCommand,
        vehicle: &VehicleParameters,
        beta: MorphAngle,
    ) {
        let now_ns = applied.header.release_ns;
        let thrust_n = applied.thrust_n.max(MIN_WEIGHTS * vehicle.weight_n());
        let bound_nm = vehicle.torque_bound_nm(beta, thrust_n);
        let is_commanded = self.is_bounded
            && applied.mode == GateMode::Normal
            && applied.command_sequence > 0
            && applied.command_seat == applied.seat;
        let memory = &mut self.memory;
        let elapsed_ns = now_ns.saturating_sub(memory.at_ns);
        let share = -libm::expm1(-1e-9 * elapsed_ns as f64 / self.lag_s);
        for axis in 0..2 {
            let (before_nm, lagged_nm) = (memory.torque_nm[axis], memory.lagged_nm[axis]);
            memory.lagged_nm[axis] = lagged_nm + share * (before_nm - lagged_nm);
            let torque_nm = Some(applied.torque_b_nm[axis]).filter(|torque| torque.is_finite());
            let torque_nm = torque_nm.unwrap_or(0.0);
            let is_full = is_commanded && torque_nm.abs() >= FULL_SHARE * bound_nm[axis];
            let goes_on = before_nm * torque_nm > 0.0 && elapsed_ns <= MAX_GAP_NS;
            memory.full_from_ns[axis] = match memory.full_from_ns[axis] {
                _ if !is_full => 0,
                from_ns if from_ns > 0 && goes_on => from_ns,
                _ => now_ns,
            };
            memory.torque_nm[axis] = torque_nm;
        }
        memory.at_ns = now_ns;
    }

    /// How long each torque had been full at the last sample \[s\], with the sign of the torque; 0 if it is not.
    pub(crate) fn full_s(&self) -> [f64; 2] {
        let TorqueMemory { torque_nm, full_from_ns, at_ns, .. } = self.memory;
        [0, 1].map(|axis| match full_from_ns[axis] {
            0 => 0.0,
            from_ns => (at_ns.saturating_sub(from_ns) as f64 * 1e-9).copysign(torque_nm[axis]),
        })
    }

    /// Torque behind the lag at the last sample \[N m\].
    pub(crate) fn lagged_nm(&self) -> [f64; 2] {
        self.memory.lagged_nm
    }

    /// Forgets for how long torques have been full, since a new owner has not given them.
    pub(crate) fn forget(&mut self) {
        self.memory.full_from_ns = [0; 2];
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

    fn applied(ms: u64, roll_nm: f64) -> AppliedCommand {
        AppliedCommand {
            header: Header { release_ns: ms * MS, ..Header::default() },
            command_sequence: 1,
            thrust_n: VehicleParameters::default().weight_n(),
            torque_b_nm: [roll_nm, 0.0, 0.0],
            mode: GateMode::Normal,
            ..AppliedCommand::default()
        }
    }

    #[test]
    fn a_torque_is_full_from_its_first_sample_to_one_side_until_it_is_less() {
        let vehicle = VehicleParameters::default();
        let full_nm = vehicle.torque_bound_nm(MorphAngle::MIN, vehicle.weight_n()).x;
        let mut torque = Torque::new(&vehicle, true);
        let mut full = |applied: &AppliedCommand| {
            torque.take(applied, &vehicle, MorphAngle::MIN);
            torque.full_s()[0]
        };
        assert!(full(&applied(1, 0.8 * full_nm)).abs() < 1e-12);
        for ms in 2..=12 {
            let expected_s = (ms - 2) as f64 * 1e-3;
            assert!((full(&applied(ms, -full_nm)) + expected_s).abs() < 1e-12, "{ms}");
        }
        assert!(full(&applied(13, full_nm)).abs() < 1e-12, "to the other side it begins anew");
        assert!((full(&applied(15, full_nm)) - 0.002).abs() < 1e-12);
        assert!(full(&applied(50, full_nm)).abs() < 1e-12, "after a gap it begins anew");
        assert!(full(&applied(51, full_nm)) > 0.0);
        assert!(full(&applied(52, f64::NAN)).abs() < 1e-12);
        let not_its_own = AppliedCommand { seat: 1, ..applied(53, full_nm) };
        assert!(full(&not_its_own).abs() < 1e-12, "a command that is held is another owner's");
        let without_thrust = AppliedCommand { thrust_n: 0.0, ..applied(54, 0.0) };
        assert!(full(&without_thrust).abs() < 1e-12);
    }

    #[test]
    fn behind_the_lag_the_torque_is_the_closed_form_of_its_step() {
        let vehicle = VehicleParameters::default();
        let mut torque = Torque::new(&vehicle, true);
        for ms in 1..=20 {
            torque.take(&applied(ms, 0.01), &vehicle, MorphAngle::MIN);
        }
        let expected_nm = -0.01 * libm::expm1(-0.019 / vehicle.rotor_lag_s);
        assert!((torque.lagged_nm()[0] - expected_nm).abs() < 1e-15);
    }
}
