//! One member of the family: what its seed draws, and whether anything could hold it in the air.

use super::{RandomError, SCENARIO};
use core::f64::consts::TAU;
use position_mpc::PositionLawConfig;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scenario::{Override, Scenario};
use vehicle::{MorphAngle, VehicleParameters};

/// A number that is drawn evenly between two others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// What it is, with its unit.
    pub name: &'static str,
    pub least: f64,
    /// Largest.
    pub most: f64,
}

/// The family, in the order in which its numbers are drawn.
pub const RANGES: [Range; 12] = [
    Range { name: "rotor lag [s]", least: 0.005, most: 0.025 },
    Range { name: "inertia over the model's", least: 0.7, most: 1.5 },
    Range { name: "mass over the model's", least: 0.8, most: 1.45 },
    Range { name: "wind [m/s]", least: 0.0, most: 4.0 },
    Range { name: "direction of the wind [rad]", least: 0.0, most: TAU },
    Range { name: "gusts, standard deviation [m/s]", least: 0.0, most: 1.0 },
    Range { name: "thrust of one rotor over a healthy one's", least: 0.5, most: 1.0 },
    Range { name: "its failure [s]", least: 4.0, most: 12.0 },
    Range { name: "pose noise over the model's", least: 0.8, most: 1.3 },
    Range { name: "pose drop-out, length [s]", least: 0.0, most: 1.5 },
    Range { name: "pose drop-out, begin [s]", least: 4.0, most: 14.0 },
    Range { name: "command delay missing from the model [s]", least: 0.0, most: 0.005 },
];

/// Numbers of one flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draw {
    /// Of the draw and of everything random in the flight.
    pub seed: u64,
    /// In the order of [`RANGES`].
    pub values: [f64; RANGES.len()],
    /// Which rotor fails, 1 to 4.
    pub rotor: u8,
}

/// Share of a torque bound that is to be left for control.
const TORQUE_RESERVE: f64 = 0.2;

impl Draw {
    /// What a seed draws.
    #[must_use]
    pub fn of(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let values = RANGES.map(|range| random.random_range(range.least..=range.most));
        Self { seed, values, rotor: random.random_range(1..=4) }
    }

    /// As values of `morphquad run --set`; noise and latency are those of `base` with what was drawn.
    #[must_use]
    pub fn flags(&self, base: &Scenario) -> Vec<String> {
        let [
            lag_s,
            inertia,
            mass,
            wind,
            direction,
            gusts,
            efficiency,
            at_s,
            noise,
            gone_s,
            gone_at_s,
            late_s,
        ] = self.values;
        let settings = base.settings();
        let fix = &settings.plant.pose_fix;
        let command_s = settings.latency.wrench_command_s;
        let [east, north] = [wind * libm::cos(direction), wind * libm::sin(direction)];
        let rotor = self.rotor;
        let mut flags = vec![
            format!("plant.mismatch.rotor_lag_s={lag_s:?}"),
            format!("plant.mismatch.inertia_scale={inertia:?}"),
            format!("plant.mismatch.mass_scale={mass:?}"),
            format!(
                "disturbance_injector.script=[{{kind=\"wind\",mean_w_m_s=[{east:?},{north:?},0.0],\
                 sigma_m_s=[{gusts:?},{gusts:?},{:?}]}},{{kind=\"rotor_efficiency\",at_s={at_s:?},\
                 rotor={rotor},efficiency={efficiency:?}}}]",
                0.5 * gusts
            ),
            format!("plant.pose_fix.position_noise_m={:?}", noise * fix.position_noise_m),
            format!("plant.pose_fix.attitude_noise_rad={:?}", noise * fix.attitude_noise_rad),
            format!(
                "plant.pose_fix.drop_outs=[{{from_s={gone_at_s:?},until_s={:?}}}]",
                gone_at_s + gone_s
            ),
            format!("latency.wrench_command_s={:?}", command_s + late_s),
        ];
        // The prediction model keeps its configured delay.
        if settings.attitude_mpc.command_delay_s.is_none() {
            flags.push(format!("attitude_mpc.command_delay_s={command_s:?}"));
        }
        flags
    }

    /// The scenario with what is `given` for all members and what is `drawn`, its flags, for this one.
    ///
    /// # Errors
    /// A number that the scenario refuses.
    pub fn scenario(&self, given: &[Override], drawn: &[String]) -> Result<Scenario, RandomError> {
        let drawn = drawn.iter().map(|flag| Override::set(flag)).collect::<Result<Vec<_>, _>>()?;
        let all = given.iter().cloned().chain(drawn).chain([Override::seed(self.seed)]);
        Ok(Scenario::load(SCENARIO, &all.collect::<Vec<_>>())?)
    }

    /// Why no law within `bounds` could hold the vehicle still in the mean wind with its weak rotor, with a fifth of each
    /// torque of the `model` left for control; none if one could.
    #[must_use]
    pub fn without_trim(
        &self,
        bounds: &PositionLawConfig,
        model: &VehicleParameters,
    ) -> Option<String> {
        let [_, _, mass, wind, _, _, efficiency, ..] = self.values;
        let weight_n = mass * model.weight_n();
        let drag_n = model.drag_n_s_m * wind;
        let (tilt_rad, tilt_max_rad) = (libm::atan2(drag_n, weight_n), bounds.tilt_max_rad);
        if tilt_rad > tilt_max_rad {
            return Some(format!("a tilt of {tilt_rad:.3} rad, bound {tilt_max_rad} rad"));
        }
        // Without torque each rotor gives a quarter; the weak one has to be asked for more.
        let thrust_n = libm::hypot(weight_n, drag_n);
        let extra_n = 0.25 * thrust_n * (1.0 / efficiency - 1.0);
        let asked_n = thrust_n + extra_n;
        let most_n = bounds.thrust_max_weights * model.weight_n();
        if asked_n > most_n {
            return Some(format!("a thrust of {asked_n:.2} N, bound {most_n:.2} N"));
        }
        // Arm and bound grow alike with the morph angle.
        let beta = MorphAngle::MIN;
        let bound_nm = model.torque_bound_nm(beta, asked_n);
        let tilting = model.geometry.arm_length_m(beta) * extra_n / bound_nm.x;
        let turning = model.yaw_coefficient_m * extra_n / bound_nm.z;
        let (share, most) = (tilting.max(turning), 1.0 - TORQUE_RESERVE);
        (share > most).then(|| {
            let [share, most] = [share, most].map(|share| share * 100.0);
            format!("{share:.0} % of a torque bound, of which {most:.0} % may be")
        })
    }
}
