//! The pilot of a flight: reference and morph command, both with preview.

use super::error::within;
use super::{
    MORPH_SPACING_NS, MorphKnot, MorphSchedule, PilotError, REFERENCE_SPACING_NS, Trajectory,
    TrajectoryConfig, diversion,
};
use runtime::{Service, inputs, outputs};
use shared_types::guidance::{MORPH_PATH_POINTS, REFERENCE_POINTS};
use shared_types::{GuidanceOrder, Header, MorphCommand, Reference, ReferencePoint, topics};
use vehicle::{MorphAngle, VehicleParameters};

inputs! {
    /// A pilot's plan is a function of time, unless an order changes it.
    pub struct PilotInputs {
        /// Where to go instead, and how wide to spread the arms.
        order: GuidanceOrder = topics::GUIDANCE_ORDER,
    }
}

outputs! {
    /// What the pilot writes.
    pub struct PilotOutputs {
        /// Trajectory to follow, with preview.
        reference: Reference = topics::REFERENCE,
        /// Commanded deployable angle, with its path.
        morph_command: MorphCommand = topics::MORPH_COMMAND,
    }
}

shared_types::memory! {
    /// All that evolves in a pilot; what it publishes does not depend on it.
    pub struct PilotMemory {
        /// Steps run so far.
        pub steps: u64,
    }
}

/// Where in its plan a flight takes it up.
#[derive(Debug, Clone, Copy, Default)]
pub struct TakenUp {
    /// Time of the plan when the flight begins \[ns\].
    pub at_ns: u64,
    /// What had been ordered by then, with instants of the plan.
    pub order: Option<GuidanceOrder>,
}

impl TakenUp {
    /// What counts at an instant of the flight \[ns\]: the time of the plan, and what has been ordered in
    /// the flight or before it.
    pub(super) fn now<'a>(
        &'a self,
        order: Option<&'a GuidanceOrder>,
        now_ns: u64,
    ) -> (Option<&'a GuidanceOrder>, u64) {
        (order.or(self.order.as_ref()), now_ns.saturating_add(self.at_ns))
    }
}

/// A flight plan.
#[derive(Debug, Clone)]
pub struct PilotConfig {
    /// Where to fly.
    pub trajectory: TrajectoryConfig,
    /// How wide to spread the arms; see [`MorphSchedule`].
    pub morph: Vec<MorphKnot>,
    /// Time between two points of the reference \[ns\].
    pub spacing_ns: u64,
    /// Where in the plan the flight begins.
    pub taken_up: TakenUp,
}

impl PilotConfig {
    /// A flight of the small vehicle along `trajectory`, without morphing.
    #[must_use]
    pub fn new(trajectory: TrajectoryConfig) -> Self {
        let smallest = MorphKnot { t_s: 0.0, angle_rad: MorphAngle::MIN.rad() };
        let taken_up = TakenUp::default();
        Self { trajectory, morph: vec![smallest], spacing_ns: REFERENCE_SPACING_NS, taken_up }
    }
}

/// Publishes where to fly and how wide to spread the arms.
#[derive(Debug, Clone)]
pub struct Pilot {
    trajectory: Trajectory,
    morph: MorphSchedule,
    spacing_ns: u64,
    taken_up: TakenUp,
    steps: u64,
}

impl Pilot {
    /// Checks a flight plan; of the vehicle only the servo's rate limit matters.
    ///
    /// # Errors
    /// [`PilotError`] naming the parameter, its value and the remedy.
    pub fn new(config: &PilotConfig, vehicle: &VehicleParameters) -> Result<Self, PilotError> {
        check_spacing(config.spacing_ns)?;
        Ok(Self {
            trajectory: Trajectory::new(&config.trajectory)?,
            morph: MorphSchedule::new(&config.morph, vehicle.servo_rate_limit_rad_s)?,
            spacing_ns: config.spacing_ns,
            taken_up: config.taken_up,
            steps: 0,
        })
    }

    /// The trajectory, for a start on it and for checks of the whole scenario.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// The schedule of the deployable angle.
    #[must_use]
    pub fn morph(&self) -> &MorphSchedule {
        &self.morph
    }

    fn reference(&self, order: Option<&GuidanceOrder>, plan_ns: u64) -> Reference {
        Reference {
            header: Header::default(),
            spacing_ns: self.spacing_ns,
            count: REFERENCE_POINTS as u64,
            points: core::array::from_fn(|i| {
                let t_ns = due_ns(plan_ns, self.spacing_ns, i);
                let point = diversion::point(&self.trajectory, order, t_ns);
                ReferencePoint {
                    position_w_m: point.position_w_m,
                    velocity_w_m_s: point.velocity_w_m_s,
                    yaw_rad: point.yaw_rad,
                }
            }),
        }
    }
}

impl Service for Pilot {
    type Inputs = PilotInputs;
    type Outputs = PilotOutputs;
    type Memory = PilotMemory;

    fn step(&mut self, now_ns: u64, inputs: &PilotInputs, outputs: &mut PilotOutputs) {
        self.steps += 1;
        let (order, plan_ns) = self.taken_up.now(inputs.order.latest(), now_ns);
        outputs.reference.write(self.reference(order, plan_ns));
        outputs.morph_command.write(morph_command(&self.morph, order, plan_ns));
    }

    fn memory(&self) -> PilotMemory {
        PilotMemory { steps: self.steps }
    }

    fn restore(&mut self, memory: &PilotMemory) -> Result<(), String> {
        self.steps = memory.steps;
        Ok(())
    }
}

/// Refuses a spacing of zero, or one whose preview would reach absurdly far.
fn check_spacing(spacing_ns: u64) -> Result<(), PilotError> {
    within("spacing_ns", spacing_ns as f64, (1e5, 1e9))
}

/// The morph command of one instant of the plan.
pub(super) fn morph_command(
    morph: &MorphSchedule,
    order: Option<&GuidanceOrder>,
    plan_ns: u64,
) -> MorphCommand {
    let angle_rad = |t_ns: u64| diversion::angle_rad(morph, order, t_ns);
    MorphCommand {
        header: Header::default(),
        angle_rad: angle_rad(plan_ns),
        spacing_ns: MORPH_SPACING_NS,
        count: MORPH_PATH_POINTS as u64,
        path_rad: core::array::from_fn(|i| angle_rad(due_ns(plan_ns, MORPH_SPACING_NS, i))),
    }
}

/// Instant of point `index` of a preview. In integers, so that a point is the same bits in each
/// preview that shows it.
fn due_ns(now_ns: u64, spacing_ns: u64, index: usize) -> u64 {
    now_ns.saturating_add(spacing_ns.saturating_mul(index as u64))
}
