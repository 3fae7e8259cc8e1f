//! What takes effect within one step of the plant, and when.

use crate::gate::Command;
use crate::ports::Inputs;
use nalgebra::Vector3;
use shared_types::{MorphCommand, WrenchCommand};
use vehicle::{Disturbance, Wrench};

/// A command for the gate to judge.
pub(crate) fn command(sample: &WrenchCommand) -> Command {
    Command {
        wrench: Wrench { thrust_n: sample.thrust_n, torque_b_nm: sample.torque_b_nm.into() },
        effective_ns: sample.header.valid_ns,
        validity_ns: sample.validity_ns,
    }
}

/// Commanded angle on the planned path, between its points.
pub(crate) fn commanded_morph(command: &MorphCommand, now_ns: u64) -> f64 {
    let age_ns = now_ns.saturating_sub(command.header.valid_ns);
    let steps = age_ns as f64 / command.spacing_ns.max(1) as f64;
    let in_use = usize::try_from(command.count).unwrap_or(usize::MAX).min(command.path_rad.len());
    let path = &command.path_rad[..in_use];
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "non-negative")]
    let index = steps as usize;
    match (path.get(index), path.get(index + 1)) {
        (Some(from), Some(to)) => from + (to - from) * (steps - index as f64),
        _ => path.last().copied().unwrap_or(command.angle_rad),
    }
}

/// Cursor over the samples that take effect within one step.
#[derive(Default)]
pub(crate) struct Effects {
    pub(crate) commands_from: usize,
    pub(crate) commands_to: usize,
    pub(crate) trips_from: usize,
    pub(crate) trips_to: usize,
    owners: usize,
    disturbances: usize,
    kicks: usize,
    morphs: usize,
}

impl Effects {
    /// Moves past everything effective at or before `now_ns`.
    pub(crate) fn advance(&mut self, now_ns: u64, inputs: &Inputs) {
        self.owners = due(inputs.attitude_owner.fresh(), self.owners, now_ns);
        self.disturbances = due(inputs.disturbance.fresh(), self.disturbances, now_ns);
        self.morphs = due(inputs.morph_command.fresh(), self.morphs, now_ns);
        self.trips_from = self.trips_to;
        self.trips_to = due(inputs.trip.fresh(), self.trips_to, now_ns);
        self.commands_from = self.commands_to;
        self.commands_to = due(inputs.wrench_command.fresh(), self.commands_to, now_ns);
    }

    /// The next instant at which something takes effect.
    pub(crate) fn next_ns(&self, inputs: &Inputs) -> Option<u64> {
        [
            valid_ns(inputs.attitude_owner.fresh(), self.owners),
            valid_ns(inputs.trip.fresh(), self.trips_to),
            valid_ns(inputs.disturbance.fresh(), self.disturbances),
            valid_ns(inputs.morph_command.fresh(), self.morphs),
            valid_ns(inputs.wrench_command.fresh(), self.commands_to),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    pub(crate) fn morph<'a>(&self, inputs: &'a Inputs) -> Option<&'a MorphCommand> {
        let fresh = self.morphs.checked_sub(1).and_then(|i| inputs.morph_command.fresh().get(i));
        fresh.or_else(|| inputs.morph_command.before_fresh())
    }

    pub(crate) fn disturbance(&self, inputs: &Inputs) -> Disturbance {
        let fresh =
            self.disturbances.checked_sub(1).and_then(|i| inputs.disturbance.fresh().get(i));
        fresh.or_else(|| inputs.disturbance.before_fresh()).map_or_else(
            Disturbance::default,
            |sample| Disturbance {
                force_w_n: sample.force_w_n.into(),
                torque_b_nm: sample.torque_b_nm.into(),
                wind_w_m_s: sample.wind_w_m_s.into(),
                rotor_efficiency: sample.rotor_efficiency,
                payload_kg: sample.payload_kg,
            },
        )
    }

    /// Body-rate jumps of the disturbances that took effect at this stop.
    pub(crate) fn take_kick(&mut self, inputs: &Inputs) -> Option<Vector3<f64>> {
        let new = inputs.disturbance.fresh().get(self.kicks..self.disturbances)?;
        self.kicks = self.disturbances;
        new.iter().map(|s| Vector3::from(s.body_rate_kick_b_rad_s)).reduce(|a, b| a + b)
    }
}

fn due<T: shared_types::Sample>(fresh: &[T], from: usize, now_ns: u64) -> usize {
    from + fresh[from..].iter().take_while(|s| s.header().valid_ns <= now_ns).count()
}

fn valid_ns<T: shared_types::Sample>(fresh: &[T], index: usize) -> Option<u64> {
    fresh.get(index).map(|s| s.header().valid_ns)
}
