//! One pass over a recording, into charts and frames.

use super::happening::{Happening, Owners, World};
use super::panel::{LOOPS, Panels, Uses};
use super::track::Track;
use ::verdict::LOST_M;
use nalgebra::Vector3;
use observe::{Course, LoopLedger};
use record::Clock;
use record::read::{RecordVisitor, RecordedEvent};
use shared_types::{
    ActuatorState, AppliedCommand, AppliedSetpoint, AttitudeReport, ControllerReport, Disturbance,
    DisturbanceOrder, GuidanceOrder, Header, LoopStats, MorphCommand, PositionReport, Reference,
    Role, Sample, Seating, StateEstimate, Topic, Truth,
};
use std::any::Any;
use vehicle::{euler_from_quaternion, rotation};

/// What moves in the picture.
#[derive(Debug, Default)]
pub(crate) struct Frames {
    /// Position (3), attitude quaternion (4), deployable angle.
    pub(super) body: Track<8>,
    pub(super) wanted_w_m: Track<3>,
    pub(super) rotor_thrust_n: Track<4>,
    /// Wind (3) and external force (3).
    pub(super) world: Track<6>,
}

/// Sees every record once.
#[derive(Debug)]
pub(crate) struct Collect {
    /// Slot owners; complete before the first sample of a recording, and ahead of the commands of a running flight.
    pub(crate) owners: Owners,
    epoch_unix_ns: u64,
    clock: Clock,
    pub(crate) panels: Panels,
    pub(crate) frames: Frames,
    pub(crate) happenings: Vec<Happening>,
    pub(crate) loops: LoopLedger,
    /// First and last instant of the vehicle \[ns\].
    pub(crate) span_ns: Option<(u64, u64)>,
    pub(super) uses: Uses,
    rotor_thrust_max_n: f64,
    world: World,
    course: Course,
    truth: Option<(u64, [f64; 3])>,
    /// Last distance from the reference \[m\].
    off_m: f64,
}

impl Collect {
    pub(crate) fn new(
        owners: Owners,
        epoch_unix_ns: u64,
        clock: Clock,
        rotor_thrust_max_n: f64,
    ) -> Self {
        Self {
            owners,
            epoch_unix_ns,
            clock,
            panels: Panels::new(rotor_thrust_max_n),
            frames: Frames::default(),
            happenings: Vec::new(),
            loops: LoopLedger::default(),
            span_ns: None,
            uses: Uses::default(),
            rotor_thrust_max_n,
            world: World::default(),
            course: Course::default(),
            truth: None,
            off_m: 0.0,
        }
    }

    /// To be called when all have been seen.
    pub(crate) fn finish(&mut self) {
        self.compare(true);
    }

    /// Why the vehicle does not fly as it should, if so.
    pub(crate) fn trouble(&self) -> Option<String> {
        if self.world.has_cut_rotors() {
            return Some("its rotors are cut".to_owned());
        }
        (self.off_m > LOST_M).then(|| format!("{:.1} m off its path", self.off_m))
    }

    fn since_start(&self, t_ns: u64) -> u64 {
        t_ns.saturating_sub(self.span_ns.map_or(0, |(from_ns, _)| from_ns))
    }

    fn truth(&mut self, truth: &Truth) {
        let t_ns = truth.header.valid_ns;
        let from_ns = self.span_ns.map_or(t_ns, |(from_ns, _)| from_ns);
        self.span_ns = Some((from_ns, t_ns.max(from_ns)));
        let q = truth.q_wb;
        let attitude = rotation(q.to_array());
        let euler = euler_from_quaternion(&attitude);
        self.panels.attitude.put_all(0, t_ns, [euler.x, euler.y, euler.z].map(f64::to_degrees));
        self.panels.morph.put(0, t_ns, truth.morph_angle_rad.to_degrees());
        let [x, y, z] = truth.position_w_m;
        let body = [x, y, z, q.w, q.x, q.y, q.z, truth.morph_angle_rad];
        self.frames.body.put(t_ns.saturating_sub(from_ns), body);
        self.course.observe_pose(t_ns, truth.position_w_m, euler.z);
        self.truth = Some((t_ns, truth.position_w_m));
        self.compare(false);
        self.loop_step(Role::Plant, &truth.header);
    }

    fn compare(&mut self, finished: bool) {
        while let Some(point) = self.course.next(finished) {
            let error_mm = core::array::from_fn(|i| (point.was_w_m[i] - point.wanted_w_m[i]) * 1e3);
            self.off_m = 1e-3 * Vector3::from(error_mm).norm();
            self.panels.error.put_all::<3>(0, point.t_ns, error_mm);
            self.frames.wanted_w_m.put(self.since_start(point.t_ns), point.wanted_w_m);
        }
    }

    /// The estimate beside the truth of its instant, if that came before it.
    fn estimate(&mut self, estimate: &StateEstimate) {
        self.loop_step(Role::Estimator, &estimate.header);
        let [x, y, z] = estimate.position_sigma_w_m;
        let t_ns = estimate.header.valid_ns;
        let sigma_m = libm::sqrt(x * x + y * y + z * z);
        self.panels.estimate.put(1, t_ns, 3e3 * sigma_m);
        if let Some((_, truth)) = self.truth.filter(|(at_ns, _)| *at_ns == t_ns) {
            let off = |i: usize| estimate.position_w_m[i] - truth[i];
            let error_m = libm::hypot(libm::hypot(off(0), off(1)), off(2));
            self.panels.estimate.put(0, t_ns, 1e3 * error_m);
        }
    }

    fn attitude_report(&mut self, report: &AttitudeReport) {
        let t_ns = report.header.release_ns;
        if !self.commands(Role::Attitude, &report.header) {
            return;
        }
        let torque = report.bounded();
        for (i, panel) in self.panels.torque.iter_mut().enumerate() {
            panel.put(1, t_ns, torque.max[i]);
            panel.put(2, t_ns, torque.min[i]);
            let increment = torque.input[i] - torque.previous[i];
            let share = increment / torque.increment_max[i];
            self.panels.increment.put(i, t_ns, share);
            let uses = &mut self.uses;
            uses.increment[i] = uses.increment[i].max(share.abs());
            uses.torque[i] = uses.torque[i].max(torque.used(i));
        }
        self.loop_step(Role::Attitude, &report.header);
    }

    fn position_report(&mut self, report: &PositionReport) {
        let t_ns = report.header.release_ns;
        if !self.commands(Role::Position, &report.header) {
            return;
        }
        let (input, min, max) = (&report.input, &report.input_min, &report.input_max);
        self.panels.tilt.put_all(0, t_ns, [input.pitch_rad, input.roll_rad].map(f64::to_degrees));
        self.panels.tilt.put(2, t_ns, max.pitch_rad.to_degrees());
        self.panels.tilt.put(3, t_ns, min.pitch_rad.to_degrees());
        self.panels.thrust.put(2, t_ns, max.thrust_n);
        self.panels.thrust.put(3, t_ns, min.thrust_n);
        let bounded = report.bounded();
        self.uses.thrust = self.uses.thrust.max(bounded.used(2));
        self.uses.tilt = self.uses.tilt.max(bounded.used(0)).max(bounded.used(1));
        self.loop_step(Role::Position, &report.header);
    }

    /// True if the sample's seat commanded at its instant.
    fn commands(&self, slot: Role, header: &Header) -> bool {
        self.owners.owner_at(slot, header.release_ns).is_none_or(|owner| owner == header.seat)
    }

    fn loop_step(&mut self, role: Role, header: &Header) {
        let Some(place) = LOOPS.iter().position(|known| *known == role) else { return };
        let us = |from: u64, to: u64| (from > 0).then(|| to.saturating_sub(from) as f64 * 1e-3);
        let t_ns = header.release_ns;
        // In lockstep there is no instant at which a step is due on the wall.
        if matches!(self.clock, Clock::Realtime { .. })
            && let Some(late_us) = us(header.release_mono_ns, header.start_mono_ns)
        {
            self.panels.lateness.put(place, t_ns, late_us);
        }
        if let Some(step_us) = us(header.start_mono_ns, header.publish_mono_ns) {
            self.panels.compute.put(place, t_ns, step_us);
        }
    }

    fn applied(&mut self, applied: &AppliedCommand) {
        let t_ns = applied.header.valid_ns;
        for (panel, torque) in self.panels.torque.iter_mut().zip(applied.torque_b_nm) {
            panel.put(0, t_ns, torque);
        }
        self.panels.thrust.put(0, t_ns, applied.thrust_n);
        self.happenings.extend(self.world.gate(t_ns, applied.mode));
    }

    fn setpoint(&mut self, applied: &AppliedSetpoint) {
        if !self.commands(Role::Attitude, &applied.header) {
            return;
        }
        let t_ns = applied.header.release_ns;
        let euler = [applied.roll_rad, applied.pitch_rad, applied.yaw_rad].map(f64::to_degrees);
        self.panels.attitude.put_all(3, t_ns, euler);
        self.panels.thrust.put(1, t_ns, applied.thrust_n);
    }

    fn disturbance(&mut self, disturbance: &Disturbance) {
        let Disturbance { header, wind_w_m_s, force_w_n, torque_b_nm, .. } = *disturbance;
        let t_ns = header.valid_ns;
        self.panels.wind.put_all(0, t_ns, wind_w_m_s);
        let speed_m_s = libm::sqrt(wind_w_m_s.iter().map(|v| v * v).sum());
        self.uses.wind_max_m_s = self.uses.wind_max_m_s.max(speed_m_s);
        self.panels.force.put_all(0, t_ns, force_w_n);
        self.panels.moment.put_all(0, t_ns, torque_b_nm);
        let ([a, b, c], [d, e, f]) = (wind_w_m_s, force_w_n);
        self.frames.world.put(self.since_start(t_ns), [a, b, c, d, e, f]);
        self.happenings.extend(self.world.disturbance(disturbance));
    }

    fn loop_stats(&mut self, stats: &LoopStats) {
        self.loops.observe(stats);
        if let Some(place) = LOOPS.iter().position(|role| *role == stats.role) {
            let missed = self.loops.missed(stats.role);
            self.panels.misses.put(place, stats.header.release_ns, missed as f64);
        }
    }
}

impl RecordVisitor for Collect {
    fn sample<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            self.truth(truth);
        } else if let Some(reference) = any.downcast_ref::<Reference>() {
            self.course.observe_reference(reference);
            self.compare(false);
        } else if let Some(estimate) = any.downcast_ref::<StateEstimate>() {
            self.estimate(estimate);
        } else if let Some(applied) = any.downcast_ref::<AppliedCommand>() {
            self.applied(applied);
        } else if let Some(applied) = any.downcast_ref::<AppliedSetpoint>() {
            self.setpoint(applied);
        } else if let Some(report) = any.downcast_ref::<AttitudeReport>() {
            self.attitude_report(report);
        } else if let Some(report) = any.downcast_ref::<PositionReport>() {
            self.position_report(report);
        } else if let Some(actuators) = any.downcast_ref::<ActuatorState>() {
            let t_ns = actuators.header.valid_ns;
            self.panels.rotors.put_all(0, t_ns, actuators.rotor_thrust_n);
            let most_n = actuators.rotor_thrust_n.into_iter().fold(0.0, f64::max);
            self.uses.rotor = self.uses.rotor.max(most_n / self.rotor_thrust_max_n);
            let since_ns = self.since_start(t_ns);
            self.frames.rotor_thrust_n.put(since_ns, actuators.rotor_thrust_n);
        } else if let Some(command) = any.downcast_ref::<MorphCommand>() {
            self.panels.morph.put(1, command.header.valid_ns, command.angle_rad.to_degrees());
        } else if let Some(disturbance) = any.downcast_ref::<Disturbance>() {
            self.disturbance(disturbance);
        } else if let Some(order) = any.downcast_ref::<GuidanceOrder>() {
            self.happenings.extend(self.world.guidance(order));
        } else if let Some(order) = any.downcast_ref::<DisturbanceOrder>() {
            self.happenings.extend(self.world.disturbance_order(order));
        } else if let Some(stats) = any.downcast_ref::<LoopStats>() {
            self.loop_stats(stats);
        } else if let Some(seating) = any.downcast_ref::<Seating>() {
            self.loops.seated(seating);
        }
    }

    fn event(&mut self, event: RecordedEvent) {
        self.happenings.push(Happening::from_event(event, self.epoch_unix_ns, self.clock));
    }
}
