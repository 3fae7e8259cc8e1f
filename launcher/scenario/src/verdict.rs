//! The section `[verdict]`: what a flight is allowed, where it is not what its own trajectory suggests.

use super::settings::{Clock, OrderSettings};
use super::{Plan, Scenario};
use crate::orders::{Load, Order};
use disturbance_injector::Event;
use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use vehicle::VehicleParameters;
use verdict::{Basis, Thresholds};

/// Speed at which an order leads the vehicle at most \[m/s\].
const ORDERED_M_S: f64 = 2.0;
/// Standard deviations that gusts may reach.
const SIGMAS: f64 = 3.0;

macro_rules! limits {
    ($($(#[$about:meta])* $key:ident: $number:ty,)*) => {
        /// Limits by their keys; what is left out is derived from the flight. Each fails the flight if it is not kept.
        #[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
        #[serde(deny_unknown_fields, default)]
        pub struct VerdictSettings {
            /// How long a recovery may take after a scripted fault, or after a process was lost \[s\].
            #[garde(range(min = 0.0, max = 60.0))]
            pub recovery_s: f64,
            $($(#[$about])* pub $key: Option<$number>,)*
        }

        impl Default for VerdictSettings {
            fn default() -> Self {
                Self { recovery_s: 3.0, $($key: None),* }
            }
        }

        impl VerdictSettings {
            /// Every limit that is set, by the key of its check.
            fn limits(&self) -> impl Iterator<Item = (&'static str, f64)> {
                let all = [$((stringify!($key), self.$key.map(f64::from))),*];
                all.into_iter().filter_map(|(key, limit)| Some((key, limit?)))
            }
        }
    };
}

limits! {
    /// Largest tracking error, apart from recoveries \[m\].
    #[garde(range(min = 0.0, max = 1e6))]
    tracking_max_m: f64,
    /// Largest mean tracking error over a second \[m\].
    #[garde(range(min = 0.0, max = 1e6))]
    tracking_sustained_max_m: f64,
    /// Largest root mean square of the tracking error \[m\].
    #[garde(range(min = 0.0, max = 1e6))]
    tracking_rms_max_m: f64,
    /// Largest error of the heading along a path, apart from recoveries \[rad\].
    #[garde(range(min = 0.0, max = 3.2))]
    heading_max_rad: f64,
    /// Largest tracking error while the flight recovers from a fault or a restart \[m\].
    #[garde(range(min = 0.0, max = 1e6))]
    recovery_max_m: f64,
    /// Mean distance from the path in the last second from which the vehicle counts as lost \[m\].
    #[garde(range(min = 0.0, max = 1e6))]
    lost_m: f64,
    /// Error of a rig's angle at the end from which the vehicle counts as lost \[rad\].
    #[garde(range(min = 0.0, max = 10.0))]
    lost_rad: f64,
    /// Largest error of a rig's angle at the end \[rad\].
    #[garde(range(min = 0.0, max = 10.0))]
    attitude_end_max_rad: f64,
    /// Longest time on the ground where the path has none \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    contact_max_s: f64,
    /// Largest angle between the vehicle's axis and the vertical \[rad\].
    #[garde(range(min = 0.0, max = 3.2))]
    tilt_max_rad: f64,
    /// Most safe-mode episodes that no scripted fault, trip or loss of a process explains.
    #[garde(skip)]
    safe_mode_max: u32,
    /// Longest safe-mode episode of all \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    safe_mode_max_s: f64,
    /// Longest stretch with clipped rotors \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    clipped_max_s: f64,
    /// Largest share of ticks with clipped rotors.
    #[garde(range(min = 0.0, max = 1.0))]
    clipped_max_share: f64,
    /// Largest share of its steps in which a controller may have no solved optimum.
    #[garde(range(min = 0.0, max = 1.0))]
    unsolved_max_share: f64,
    /// Largest share of its releases that a loop may miss, or run without final inputs.
    #[garde(range(min = 0.0, max = 1.0))]
    missed_max_share: f64,
    /// Most samples that may come after their step, as a share of the releases of their loop.
    #[garde(range(min = 0.0, max = 100.0))]
    late_max_share: f64,
}

impl Scenario {
    /// What a flight of this scenario is judged by: derived from what it is to do, and then as `[verdict]`
    /// has it.
    #[must_use]
    pub fn thresholds(&self) -> Thresholds {
        let mut thresholds = Thresholds::derive(&self.basis());
        // A limit that others are made of comes before them.
        for (key, limit) in self.settings.verdict.limits() {
            let known = thresholds.set(key, limit);
            debug_assert!(known, "no check is called {key}");
        }
        thresholds
    }

    fn basis(&self) -> Basis {
        let settings = &self.settings;
        let plan = self.plan();
        let (speed_m_s, tilt_rad, step_rad, step_at_s) = match &plan {
            Plan::Flight(_) => {
                let planned = self
                    .trajectory()
                    .map_or(0.0, |t| t.peak_speed_m_s(self.flown_of_the_plan_ns()));
                let tilt_rad = self.position_law().map_or(0.35, |law| law.tilt_max_rad);
                (planned, tilt_rad, None, f64::NEG_INFINITY)
            }
            Plan::Rig(rig) => {
                let step = &rig.step;
                let turns = [step.roll_rad, step.pitch_rad, step.yaw_rad].map(f64::abs);
                let tilt_rad = libm::hypot(step.roll_rad, step.pitch_rad);
                (0.0, tilt_rad, Some(turns.into_iter().fold(0.0, f64::max)), step.at_s)
            }
        };
        let orders = || settings.order.iter().filter_map(OrderSettings::order);
        let is_led = orders().any(|order| matches!(order, Order::Goto(_)));
        let gate = &settings.plant.gate;
        Basis {
            // Where loops and samples take time, some are late, as by the wall clock.
            realtime: settings.scenario.clock == Clock::Realtime || !settings.timing.is_empty(),
            planned_s: settings.scenario.duration_s,
            speed_m_s: if is_led { speed_m_s.max(ORDERED_M_S) } else { speed_m_s },
            push_m_s2: self.push_m_s2(),
            tilt_rad,
            step_rad,
            after_step_s: settings.scenario.duration_s - step_at_s,
            samples_per_step: self.samples_per_step(),
            gate_s: gate.hold_max_s + gate.descend_after_s.min(gate.level_max_s),
            faults: !settings.fault.is_empty(),
        }
    }

    /// Samples of the fastest loop in a period of the slowest.
    fn samples_per_step(&self) -> f64 {
        let graph = self.graph().ok();
        let rates = graph.iter().flat_map(runtime::Graph::nodes).map(|node| node.rate.hz());
        let ends = rates.fold(None, |ends: Option<(f64, f64)>, hz| {
            Some(ends.map_or((hz, hz), |(least, most)| (least.min(hz), most.max(hz))))
        });
        ends.map_or(1.0, |(least, most)| most / least)
    }

    /// Largest acceleration that anything in the script gives the vehicle, or that its controllers do not
    /// know of \[m/s²\].
    fn push_m_s2(&self) -> f64 {
        let settings = &self.settings;
        let push = Push { vehicle: self.real_vehicle() };
        let scripted = settings.disturbance_injector.script.iter().map(|event| match event {
            Event::Constant(e) => push.load(&e.load),
            Event::Step(e) => push.load(&e.load),
            Event::Pulse(e) => push.load(&e.load),
            Event::Sine(e) => push.load(&e.load),
            Event::Ramp(e) => push.load(&e.load),
            Event::Wind(e) => push.wind(&e.mean_w_m_s, &e.sigma_m_s),
            Event::Payload(e) => push.payload(e.mass_kg),
            Event::RotorEfficiency(e) => push.rotor(e.efficiency),
            Event::Rd(_) | Event::Kick(_) => 0.0,
        });
        let orders = settings.order.iter().filter_map(OrderSettings::order);
        let ordered = orders.map(|order| match order {
            Order::Disturb(disturb) => match disturb.load {
                Load::Wind { mean_w_m_s, sigma_w_m_s } => push.wind(&mean_w_m_s, &sigma_w_m_s),
                Load::ForceWN(force) => push.force(&force),
                Load::PayloadKg(mass_kg) => push.payload(mass_kg),
                Load::Rotor { efficiency, .. } => push.rotor(efficiency),
                Load::TorqueBNm(_) | Load::KickBRadS(_) => 0.0,
            },
            Order::Goto(_) | Order::Morph(_) | Order::Calm(_) => 0.0,
        });
        let unknown = (settings.plant.mismatch.mass_scale - 1.0).abs() * push.vehicle.gravity_m_s2;
        scripted.chain(ordered).sum::<f64>() + unknown
    }
}

/// What things do to a vehicle.
struct Push {
    vehicle: VehicleParameters,
}

impl Push {
    fn force(&self, force_w_n: &[f64; 3]) -> f64 {
        norm(force_w_n) / self.vehicle.mass_kg
    }

    fn wind(&self, mean_w_m_s: &[f64; 3], sigma_m_s: &[f64; 3]) -> f64 {
        let speed_m_s = norm(mean_w_m_s) + SIGMAS * norm(sigma_m_s);
        self.vehicle.drag_n_s_m * speed_m_s / self.vehicle.mass_kg
    }

    fn load(&self, load: &disturbance_injector::Load) -> f64 {
        self.force(&load.force_w_n) + self.wind(&load.wind_w_m_s, &[0.0; 3])
    }

    fn payload(&self, mass_kg: f64) -> f64 {
        self.vehicle.gravity_m_s2 * mass_kg / (self.vehicle.mass_kg + mass_kg)
    }

    fn rotor(&self, efficiency: f64) -> f64 {
        self.vehicle.gravity_m_s2 * (1.0 - efficiency)
    }
}

fn norm([x, y, z]: &[f64; 3]) -> f64 {
    libm::hypot(libm::hypot(*x, *y), *z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Override, shipped};
    use verdict::CHECKS;

    fn scenario(text: &str) -> Scenario {
        Scenario::from_text("a.toml", text, &[]).unwrap()
    }

    fn limit(text: &str, key: &str) -> f64 {
        scenario(text).thresholds().limit(key).unwrap()
    }

    #[test]
    fn limits_follow_from_the_trajectory_the_wind_and_the_vehicle() {
        let at_rest = limit("[pilot]\nkind = \"hover\"", "tracking_max_m");
        assert!((at_rest - 0.15).abs() < 1e-12, "{at_rest}");
        let eight = "[pilot]\nkind = \"figure8\"\n";
        // A cos 0 w, B 2 w and C w, at the crossing point.
        let w = core::f64::consts::TAU / 8.0;
        let speed_m_s = w * f64::sqrt(1.0 + 1.0 + 0.0625);
        let moving = limit(eight, "tracking_max_m");
        assert!((moving - at_rest - 0.05 * speed_m_s).abs() < 1e-3, "{moving}");
        let windy =
            "[[disturbance_injector.script]]\nkind = \"wind\"\nmean_w_m_s = [3.0, 0.0, 0.0]";
        assert!(limit(windy, "tracking_max_m") > at_rest);
        let heavy = "[plant.mismatch]\nmass_scale = 1.1";
        let unknown = limit(heavy, "tracking_max_m") - at_rest;
        assert!((unknown - 0.03 * 0.1 * 9.81).abs() < 1e-3, "{unknown}");
        let led = "[[order]]\nat_s = 1.0\ngoto = { position_w_m = [1.0, 0.0, 2.0] }";
        assert!((limit(led, "tracking_max_m") - at_rest - 0.1).abs() < 1e-12);
        let rig = "[pilot]\nkind = \"attitude_step\"\nangle_rad = 0.4";
        assert!((limit(rig, "attitude_end_max_rad") - 0.1).abs() < 1e-12);
    }

    #[test]
    fn every_key_of_the_section_sets_the_limit_of_that_name_and_others_are_refused() {
        let mut settable = 0;
        for check in &CHECKS {
            let edit = Override::set(&format!("verdict.{}=1", check.key)).unwrap();
            if let Ok(scenario) = Scenario::load("hover", &[edit]) {
                let limit = scenario.thresholds().limit(check.key);
                assert_eq!(limit, Some(1.0), "{}", check.key);
                settable += 1;
            }
        }
        let settings = VerdictSettings::default();
        assert_eq!((settable, settings.limits().count()), (17, 0));
        let refused = Scenario::from_text("a.toml", "[verdict]\ntracking_maxi_m = 1.0\n", &[]);
        let refused = refused.unwrap_err();
        let problem = refused.problems().next().unwrap();
        assert_eq!((problem.line(), problem.key()), (Some(2), "verdict.tracking_maxi_m"));
        assert!(problem.remedy().contains("`tracking_max_m`"), "{problem:?}");
        let below = Scenario::from_text("a.toml", "[verdict]\ntilt_max_rad = -0.1\n", &[]);
        assert!(below.unwrap_err().problems().next().unwrap().remedy().contains("at least"));
    }

    #[test]
    fn every_shipped_scenario_has_limits_below_those_of_a_lost_vehicle() {
        for name in shipped::names() {
            let thresholds = Scenario::load(name, &[]).unwrap().thresholds();
            let limit = |key| thresholds.limit(key).unwrap();
            assert!(limit("tracking_max_m") < 0.5 * limit("lost_m"), "{name}");
            assert!(limit("attitude_end_max_rad") < limit("lost_rad"), "{name}");
            assert!(limit("tilt_max_rad") < 1.2, "{name}");
        }
    }
}
