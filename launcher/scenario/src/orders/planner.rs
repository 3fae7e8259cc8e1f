//! From an order to the sample that states what holds from now on.

use super::{Calm, Disturb, FLOOR_M, Goto, Load, Morph, Order, OutOfRange, REACH_M};
use crate::configs::landing_s;
use crate::{Plan, Scenario};
use ::pilot::{MorphSchedule, PilotError, Trajectory, divert};
use core::fmt::Write as _;
use runtime::Graph;
use serde::{Deserialize, Serialize};
use shared_types::time::{ns_from_s, s_from_ns};
use shared_types::{
    AngleDiversion, DISTURBANCE_ORDERS, DisturbanceKind, DisturbanceOrder, Flag, GuidanceOrder,
    Header, OrderedDisturbance, Role,
};
use thiserror::Error;

/// From an order's arrival to what pilot and injector can have reached meanwhile, beyond their lead \[ns\].
const MARGIN_NS: u64 = 20_000_000;
/// What was over this long ago is left out of the next sample \[ns\].
const KEPT_NS: u64 = 1_000_000_000;

/// Why an order is refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RefusedOrder {
    /// A number.
    #[error("{}", .0.sentence())]
    OutOfRange(OutOfRange),
    /// The rig holds the vehicle.
    #[error(
        "this flight steps the attitude on a rig and goes nowhere: fly hover, figure8 or waypoints"
    )]
    Rig,
    /// The servo is not that fast.
    #[error(
        "the arms cannot be at {angle_deg} deg within {over_s} s, the servo gives {limit_deg_s:.0} deg/s: give at least {shortest_s:.3} s"
    )]
    TooFast {
        /// β \[°\].
        angle_deg: f64,
        /// Time asked for \[s\].
        over_s: f64,
        /// Rate limit of the servo \[°/s\].
        limit_deg_s: f64,
        /// Shortest time \[s\].
        shortest_s: f64,
    },
    /// Time is over.
    #[error("this would begin at {begins_s:.3} s, and the flight ends at {end_s} s")]
    TooLate {
        /// When it would begin \[s\].
        begins_s: f64,
        /// End of the flight \[s\].
        end_s: f64,
    },
    /// No place for another one.
    #[error("{DISTURBANCE_ORDERS} disturbances are under way: end them with `disturb off` first")]
    TooMany,
}

/// What has been ordered, for summary and log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OrderReport {
    /// The order as a sentence.
    pub order: String,
    /// Logical time at which it was given \[s\].
    pub at_s: f64,
    /// From when on it shows \[s\].
    pub begins_s: f64,
    /// When the vehicle is to be there, or the disturbance over \[s\].
    pub done_s: Option<f64>,
    /// By the scenario and not by hand.
    pub scripted: bool,
}

impl OrderReport {
    /// What was ordered and when it begins and ends.
    #[must_use]
    pub fn sentence(&self) -> String {
        let mut text = format!("{}: from {:.3} s on", self.order, self.begins_s);
        if let Some(done_s) = self.done_s {
            let _ = write!(text, ", done at {done_s:.3} s");
        }
        text
    }
}

/// A sample to publish.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::large_enum_variant, reason = "one at a time, and handed on at once")]
pub enum Sent {
    /// To the pilot.
    Guidance(GuidanceOrder),
    /// To the injector.
    Disturbance(DisturbanceOrder),
}

/// An order that can be carried out.
#[derive(Debug, Clone)]
pub struct Planned {
    /// What is to be published.
    pub sent: Sent,
    /// What is to be reported.
    pub report: OrderReport,
}

/// Knows what pilot and injector do, and so what an order makes of it.
#[derive(Debug, Clone)]
pub struct Planner {
    /// None on a rig.
    trajectory: Option<Trajectory>,
    schedule: MorphSchedule,
    rate_limit_rad_s: f64,
    floor_m: f64,
    end_ns: u64,
    /// Time of the plan when the flight begins \[ns\]; guidance has instants of the plan.
    taken_up_ns: u64,
    guidance: GuidanceOrder,
    disturbance: DisturbanceOrder,
    /// The highest place that the vehicle is sent to \[m\].
    highest_m: f64,
    /// Everything that was ordered.
    pub reports: Vec<OrderReport>,
}

impl Planner {
    /// Of a scenario's plan, before anything is ordered.
    ///
    /// # Errors
    /// None for a scenario that has been loaded.
    pub fn of(scenario: &Scenario) -> Result<Self, PilotError> {
        let rate_limit_rad_s = scenario.modelled_vehicle().servo_rate_limit_rad_s;
        let (trajectory, morph, taken_up) = match scenario.plan() {
            Plan::Flight(config) => {
                (Some(Trajectory::new(&config.trajectory)?), config.morph, config.taken_up)
            }
            Plan::Rig(config) => (None, config.morph, config.taken_up),
        };
        Ok(Self {
            trajectory,
            schedule: MorphSchedule::new(&morph, rate_limit_rad_s)?,
            rate_limit_rad_s,
            floor_m: floor_m(scenario),
            end_ns: scenario.duration_ns(),
            taken_up_ns: taken_up.at_ns,
            guidance: taken_up.order.unwrap_or_default(),
            disturbance: DisturbanceOrder::default(),
            highest_m: scenario.highest_m(),
            reports: Vec::new(),
        })
    }

    /// Goes on from the last orders that another launcher had published.
    pub fn go_on(&mut self, guidance: &GuidanceOrder, disturbance: &DisturbanceOrder) {
        // Without an order since it began, a flight that was taken up goes on with the one that it had.
        if guidance.header.sequence > 0 {
            self.guidance = *guidance;
        }
        self.disturbance = *disturbance;
    }

    /// How long a landing takes from the highest place that the vehicle has been sent to \[s\].
    #[must_use]
    pub fn landing_s(&self) -> f64 {
        landing_s(self.highest_m)
    }

    /// The first instant that no loop that follows has reached when time is `now_ns` and may go on to
    /// `allowed_ns`, whichever is later \[ns\].
    #[must_use]
    pub fn begin_ns(order: &Order, graph: &Graph, now_ns: u64, allowed_ns: u64) -> u64 {
        let lead_ns = Self::ahead_ns(order, graph);
        // Lockstep: no loop is past what is allowed, and the sample comes before more is.
        if allowed_ns > now_ns { allowed_ns } else { now_ns + lead_ns }
    }

    /// How long before its instant an order has to be given \[ns\].
    #[must_use]
    pub fn ahead_ns(order: &Order, graph: &Graph) -> u64 {
        let role = match order {
            Order::Goto(_) | Order::Morph(_) => Role::Pilot,
            Order::Disturb(_) | Order::Calm(_) => Role::Disturbance,
        };
        MARGIN_NS + graph.node(role).map_or(0, |node| node.lead_ns)
    }

    /// Takes an order at `now_ns` that shows from `begin_ns` on.
    ///
    /// # Errors
    /// It is out of range, or makes no sense in this flight or now. Nothing has changed then.
    pub fn order(
        &mut self,
        order: &Order,
        (now_ns, begin_ns): (u64, u64),
        scripted: bool,
    ) -> Result<Planned, RefusedOrder> {
        order.check(self.floor_m).map_err(RefusedOrder::OutOfRange)?;
        // Orders take effect in the order in which they are given.
        let sent = match order {
            Order::Goto(_) | Order::Morph(_) => &self.guidance.header,
            Order::Disturb(_) | Order::Calm(_) => &self.disturbance.header,
        };
        let header = Header {
            sequence: sent.sequence + 1,
            release_ns: now_ns.max(sent.release_ns),
            valid_ns: begin_ns.max(sent.valid_ns),
            ..Header::default()
        };
        let valid_ns = header.valid_ns;
        if valid_ns >= self.end_ns {
            let (begins_s, end_s) = (s_from_ns(valid_ns), s_from_ns(self.end_ns));
            return Err(RefusedOrder::TooLate { begins_s, end_s });
        }
        let (sent, (from_ns, done_ns)) = match order {
            Order::Goto(goto) => {
                let done_ns = self.go_to(goto, valid_ns)?;
                self.guidance.header = header;
                (Sent::Guidance(self.guidance), (valid_ns, Some(done_ns)))
            }
            Order::Morph(morph) => {
                let done_ns = self.morph(morph, valid_ns)?;
                self.guidance.header = header;
                (Sent::Guidance(self.guidance), (valid_ns, Some(done_ns)))
            }
            Order::Disturb(disturb) => {
                let span = self.disturb(disturb, now_ns, valid_ns)?;
                self.disturbance.header = header;
                (Sent::Disturbance(self.disturbance), span)
            }
            Order::Calm(Calm { script }) => {
                let script_off = Flag::from(*script || self.disturbance.script_off.is_set());
                self.disturbance = DisturbanceOrder { header, script_off, ..Default::default() };
                (Sent::Disturbance(self.disturbance), (valid_ns, None))
            }
        };
        let report = OrderReport {
            order: order.to_string(),
            at_s: s_from_ns(now_ns),
            begins_s: s_from_ns(from_ns),
            done_s: done_ns.map(s_from_ns),
            scripted,
        };
        self.reports.push(report.clone());
        Ok(Planned { sent, report })
    }

    fn go_to(&mut self, goto: &Goto, begin_ns: u64) -> Result<u64, RefusedOrder> {
        let Some(trajectory) = &self.trajectory else { return Err(RefusedOrder::Rig) };
        let begin_ns = begin_ns + self.taken_up_ns;
        let before = Some(&self.guidance);
        let position = divert::position(trajectory, before, goto.position_w_m, begin_ns);
        let goal_rad = goto.yaw_deg.map(f64::to_radians);
        let yaw = divert::yaw(trajectory, before, goal_rad, begin_ns);
        (self.guidance.position, self.guidance.yaw) = (position, yaw);
        self.highest_m = self.highest_m.max(goto.position_w_m[2]);
        let there_ns = divert::rest_ns(begin_ns, position.brake_s, position.move_s);
        let turned_ns = divert::rest_ns(yaw.begin_ns, yaw.brake_s, yaw.move_s);
        Ok(there_ns.max(turned_ns).saturating_sub(self.taken_up_ns))
    }

    fn morph(&mut self, morph: &Morph, begin_ns: u64) -> Result<u64, RefusedOrder> {
        let &Morph { angle_deg, over_s } = morph;
        let goal = (angle_deg.to_radians(), over_s);
        let limit = self.rate_limit_rad_s;
        let plan_ns = begin_ns + self.taken_up_ns;
        let way = divert::morph(&self.schedule, Some(&self.guidance), goal, limit, plan_ns);
        let way = way.map_err(|shortest_s| RefusedOrder::TooFast {
            angle_deg,
            over_s,
            limit_deg_s: limit.to_degrees(),
            shortest_s: (shortest_s * 1e3).ceil() / 1e3,
        })?;
        self.guidance.morph = way;
        let AngleDiversion { brake_s, move_s, .. } = way;
        Ok(divert::rest_ns(begin_ns, brake_s, move_s))
    }

    /// Gives first and, if it has one, last instant.
    fn disturb(
        &mut self,
        disturb: &Disturb,
        now_ns: u64,
        valid_ns: u64,
    ) -> Result<(u64, Option<u64>), RefusedOrder> {
        let begin_ns = valid_ns + ns_from_s(disturb.in_s);
        let is_burst = matches!(disturb.load, Load::KickBRadS(_));
        let done_ns = disturb.for_s.map(|for_s| begin_ns + ns_from_s(for_s));
        let count = usize::try_from(self.disturbance.count).unwrap_or(DISTURBANCE_ORDERS);
        let mut held: Vec<OrderedDisturbance> = self.disturbance.entries[..count].to_vec();
        held.retain(|entry| {
            let is_kick = entry.kind == DisturbanceKind::Kick;
            let over_ns = if is_kick { entry.begin_ns } else { entry.until_ns };
            over_ns.saturating_add(KEPT_NS) > now_ns
        });
        if held.len() >= DISTURBANCE_ORDERS {
            return Err(RefusedOrder::TooMany);
        }
        let until_ns = if is_burst { None } else { done_ns };
        held.push(OrderedDisturbance {
            // That of the sample that is to carry it first.
            number: self.disturbance.header.sequence + 1,
            begin_ns,
            until_ns: until_ns.unwrap_or(u64::MAX),
            ..sample_of(&disturb.load)
        });
        self.disturbance.count = held.len() as u64;
        self.disturbance.entries =
            core::array::from_fn(|place| held.get(place).copied().unwrap_or_default());
        Ok((begin_ns, until_ns))
    }
}

/// Lowest place at which a vehicle may be ordered to rest \[m\].
fn floor_m(scenario: &Scenario) -> f64 {
    let plant = &scenario.settings().plant;
    if plant.ground { FLOOR_M } else { -REACH_M }
}

fn sample_of(load: &Load) -> OrderedDisturbance {
    let none = OrderedDisturbance::default();
    match *load {
        Load::Wind { mean_w_m_s, sigma_w_m_s } => OrderedDisturbance {
            wind_w_m_s: mean_w_m_s,
            gust_sigma_w_m_s: sigma_w_m_s,
            kind: DisturbanceKind::Wind,
            ..none
        },
        Load::ForceWN(force_w_n) => {
            OrderedDisturbance { force_w_n, kind: DisturbanceKind::Force, ..none }
        }
        Load::TorqueBNm(torque_b_nm) => {
            OrderedDisturbance { torque_b_nm, kind: DisturbanceKind::Torque, ..none }
        }
        Load::KickBRadS(body_rate_kick_b_rad_s) => {
            OrderedDisturbance { body_rate_kick_b_rad_s, kind: DisturbanceKind::Kick, ..none }
        }
        Load::PayloadKg(payload_kg) => {
            OrderedDisturbance { payload_kg, kind: DisturbanceKind::Payload, ..none }
        }
        Load::Rotor { rotor, efficiency } => {
            OrderedDisturbance { rotor, efficiency, kind: DisturbanceKind::Rotor, ..none }
        }
    }
}
