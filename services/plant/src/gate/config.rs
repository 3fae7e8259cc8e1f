//! Limits of the gate, as a scenario may set them.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::sensors::finite;
use shared_types::time::ns_from_s;

/// Limits of the gate.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct GateConfig {
    /// Longest HOLD; the last command's validity, two control periods, may end it sooner.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub hold_max_s: f64,
    /// Longest LEVEL; then the rotors are cut.
    #[garde(range(min = 0.0, max = 60.0), custom(finite))]
    pub level_max_s: f64,
    /// How long LEVEL keeps the vehicle where it is, or on its reference. After that it descends, so that a vehicle that no controller commands any
    /// more is nearer the ground when its rotors are cut; never if this is as long as `level_max_s`.
    #[garde(range(min = 0.0, max = 60.0), custom(finite))]
    pub descend_after_s: f64,
    /// Speed of that descent. Where estimates have ended it is beside the one at the last command, by the accelerometer alone:
    /// its bias takes a few tenths of a metre per second from it, or adds them.
    #[garde(range(min = 0.0, max = 5.0), custom(finite))]
    pub descend_m_s: f64,
    /// Tilt that LEVEL cannot recover from.
    #[garde(range(min = 0.1, max = 3.2), custom(finite))]
    pub tip_over_tilt_rad: f64,
    /// How long that tilt may last.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub tip_over_s: f64,
    /// Torque of LEVEL is at most this times m g L(β), once tilt and rate are below `recovered_tilt_rad` and
    /// `recovered_rate_rad_s`; before that, and while it follows the reference, it is that of RECOVER.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub level_torque_fraction: f64,
    /// Tilt beyond which the gate itself answers a trip, by RECOVER, and holds no command that is no longer valid: the
    /// bound on the tilt that position controllers may ask for, so that no controller has been made for more.
    #[garde(range(min = 0.0, max = 3.2), custom(finite))]
    pub recover_tilt_rad: f64,
    /// Rate about roll and pitch beyond which it does.
    #[garde(range(min = 0.0, max = 100.0), custom(finite))]
    pub recover_rate_rad_s: f64,
    /// Tilt below which commands count again.
    #[garde(range(min = 0.0, max = 3.2), custom(finite), custom(at_most(self.recover_tilt_rad, "recover_tilt_rad")))]
    pub recovered_tilt_rad: f64,
    /// Rate about roll and pitch below which they do.
    #[garde(range(min = 0.0, max = 100.0), custom(finite), custom(at_most(self.recover_rate_rad_s, "recover_rate_rad_s")))]
    pub recovered_rate_rad_s: f64,
    /// Longest RECOVER; then commands count, or LEVEL begins.
    #[garde(range(min = 0.0, max = 60.0), custom(finite))]
    pub recover_max_s: f64,
    /// Torque of RECOVER is at most this times m g L(β). At hover thrust each pair of rotors carries half
    /// of the weight, so that one half is what roll and pitch can have at once without clipping.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub recover_torque_fraction: f64,
    /// Undamped frequency of RECOVER's attitude loop, if rotors had no lag. It is fast, because the vehicle gains speed
    /// while it is tilted; with a lag of 20 ms its slowest time constant is less than a tenth of a second.
    #[garde(range(min = 0.1, max = 100.0), custom(finite))]
    pub recover_bandwidth_rad_s: f64,
    /// Damping ratio of that loop, if rotors had no lag.
    #[garde(range(min = 0.1, max = 5.0), custom(finite))]
    pub recover_damping: f64,
    /// Undamped frequency of LEVEL's attitude loop; far below 1 / rotor lag.
    #[garde(range(min = 0.1, max = 50.0), custom(finite))]
    pub level_bandwidth_rad_s: f64,
    /// Damping ratio of that loop.
    #[garde(range(min = 0.1, max = 5.0), custom(finite))]
    pub level_damping: f64,
    /// Time constant with which the accelerometer corrects the gyro's tilt.
    #[garde(range(min = 0.1, max = 1e3), custom(finite))]
    pub filter_time_constant_s: f64,
    /// Largest thrust that a command may ask for, in weights.
    #[garde(range(min = 1.0, max = 100.0), custom(finite))]
    pub thrust_range_weights: f64,
    /// Largest torque that a command may ask for, relative to the most the rotors can ever give;
    /// above 1 only for a plant without rotor limits.
    #[garde(range(min = 0.1, max = 1e3), custom(finite))]
    pub torque_range_factor: f64,
    /// A command is never valid for longer.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub validity_max_s: f64,
}

/// Accepts what is no larger than another key, beyond which RECOVER begins: it ends below.
fn at_most(largest: f64, name: &'static str) -> impl Fn(&f64, &()) -> garde::Result {
    move |value, ()| {
        if *value <= largest {
            Ok(())
        } else {
            Err(garde::Error::new(format!("is larger than {name}, {largest}")))
        }
    }
}

impl Default for GateConfig {
    fn default() -> Self {
        Self {
            hold_max_s: 0.020,
            level_max_s: 6.0,
            descend_after_s: 2.0,
            descend_m_s: 0.7,
            tip_over_tilt_rad: 1.2,
            tip_over_s: 0.2,
            level_torque_fraction: 0.25,
            recover_tilt_rad: 0.35,
            recover_rate_rad_s: 4.0,
            recovered_tilt_rad: 0.3,
            recovered_rate_rad_s: 3.0,
            recover_max_s: 2.0,
            recover_torque_fraction: 0.5,
            recover_bandwidth_rad_s: 20.0,
            recover_damping: 0.7,
            level_bandwidth_rad_s: 10.0,
            level_damping: 1.0,
            filter_time_constant_s: 3.0,
            thrust_range_weights: 4.0,
            torque_range_factor: 1.0,
            validity_max_s: 0.2,
        }
    }
}

impl GateConfig {
    pub(super) fn validity_max_ns(&self) -> u64 {
        ns_from_s(self.validity_max_s)
    }

    pub(super) fn hold_max_ns(&self) -> u64 {
        ns_from_s(self.hold_max_s)
    }

    pub(super) fn level_max_ns(&self) -> u64 {
        ns_from_s(self.level_max_s)
    }

    pub(super) fn descend_after_ns(&self) -> u64 {
        ns_from_s(self.descend_after_s)
    }

    pub(super) fn recover_max_ns(&self) -> u64 {
        ns_from_s(self.recover_max_s)
    }

    pub(super) fn tip_over_ns(&self) -> u64 {
        ns_from_s(self.tip_over_s)
    }
}

#[cfg(test)]
mod tests {
    use super::GateConfig;
    use garde::Validate as _;

    #[test]
    fn a_recovery_ends_below_where_it_begins_and_a_vehicle_may_be_held_up() {
        let refused = |change: fn(&mut GateConfig)| {
            let mut config = GateConfig::default();
            change(&mut config);
            config.validate().map_err(|report| report.to_string()).err()
        };
        assert_eq!(refused(|_| {}), None);
        let tilt = refused(|config| config.recovered_tilt_rad = 0.36).expect("is refused");
        assert!(
            tilt.contains("recovered_tilt_rad: is larger than recover_tilt_rad, 0.35"),
            "{tilt}"
        );
        let rate = refused(|config| config.recover_rate_rad_s = 2.9).expect("is refused");
        assert!(
            rate.contains("recovered_rate_rad_s: is larger than recover_rate_rad_s, 2.9"),
            "{rate}"
        );
        assert!(refused(|config| config.thrust_range_weights = 0.9).is_some());
        assert!(refused(|config| config.torque_range_factor = 0.0).is_some());
    }
}
