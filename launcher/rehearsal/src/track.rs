//! The record of a rehearsed flight: motion, references and commands.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use vehicle::quaternion_from_euler;

/// True state of the simulated vehicle at one instant. Frames are world ENU (`_w_`) and body FLU (`_b_`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The instant \[s\].
    pub t_s: f64,
    /// Position \[m\].
    pub position_w_m: [f64; 3],
    /// Velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Attitude, body to world, Hamilton quaternion: w, x, y, z.
    pub q_wb: [f64; 4],
    /// Angular velocity, in body axes \[rad/s\].
    pub body_rate_b_rad_s: [f64; 3],
}

/// A sample of the position reference, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// The instant \[s\].
    pub t_s: f64,
    /// Position \[m\].
    pub position_w_m: [f64; 3],
    /// Velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Heading, counter-clockwise from east \[rad\].
    pub yaw_rad: f64,
}

/// Where the vehicle was at an instant of a rehearsed flight: the instant \[s\], x, y and z \[m\] and the attitude, body to
/// world, as w, x, y, z.
pub type Posture = [f64; 8];

/// Time between two postures of a course \[s\].
const COURSE_SPACING_S: f64 = 0.02;

/// The record of one rehearsed flight.
#[derive(Debug, Clone, Default)]
pub struct Track {
    motions: Vec<Motion>,
    wanted: Vec<Wanted>,
    /// Instant \[s\], φ, θ, ψ \[rad\].
    setpoints: Vec<(f64, [f64; 3])>,
    /// Instant \[s\] and command of the judged controller, relative to the largest command.
    commands: Vec<(f64, [f64; 4])>,
    /// First instant at which the actuation guard replaced the controller \[s\].
    unguided_s: Option<f64>,
}

/// Errors at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The instant \[s\].
    pub t_s: f64,
    /// Angle between body z and the vertical \[rad\].
    pub tilt_rad: f64,
    /// Angle of the rotation from the set point to the attitude \[rad\].
    pub attitude_rad: f64,
    /// Norm of the body rate \[rad/s\].
    pub rate_rad_s: f64,
    /// Distance from the reference \[m\].
    pub position_m: f64,
    /// Norm of the velocity error \[m/s\].
    pub velocity_m_s: f64,
    /// Height above z = 0 \[m\].
    pub height_m: f64,
    /// Absolute difference between the heading and that of the reference, at most π \[rad\].
    pub heading_rad: f64,
}

impl Track {
    /// Records the state of the vehicle. Instants must not decrease, here and in the other lists.
    pub fn moved(&mut self, motion: Motion) {
        self.motions.push(motion);
    }

    /// Records a position reference, which applies from its instant on.
    pub fn wants(&mut self, wanted: Wanted) {
        self.wanted.push(wanted);
    }

    /// Records the attitude set point φ, θ, ψ \[rad\], which applies from `t_s` \[s\] on.
    pub fn tracks(&mut self, t_s: f64, gamma_rad: [f64; 3]) {
        self.setpoints.push((t_s, gamma_rad));
    }

    /// Records a command of the judged controller; each component is relative to the largest command.
    pub fn commanded(&mut self, t_s: f64, share: [f64; 4]) {
        self.commands.push((t_s, share));
    }

    /// Records that the actuation guard levels the vehicle or has cut the rotors; the first instant counts.
    pub fn unguided(&mut self, t_s: f64) {
        self.unguided_s.get_or_insert(t_s);
    }

    /// First instant at which the actuation guard replaced the controller \[s\], if there is one.
    #[must_use]
    pub fn unguided_s(&self) -> Option<f64> {
        self.unguided_s
    }

    /// Where the vehicle was from `from_s` to `until_s` \[s\], about every 20 ms and at last where it was recorded last.
    pub(crate) fn course(&self, from_s: f64, until_s: f64) -> Vec<Posture> {
        let mut due_s = from_s;
        let mut course = Vec::new();
        let within = |motion: &&Motion| (from_s..=until_s).contains(&motion.t_s);
        let mut motions = self.motions.iter().filter(within).peekable();
        while let Some(motion) = motions.next() {
            let Motion { t_s, position_w_m: [x_m, y_m, z_m], q_wb: [w, i, j, k], .. } = *motion;
            let posture = [t_s, x_m, y_m, z_m, w, i, j, k];
            let is_due = t_s >= due_s || motions.peek().is_none();
            // What is no number has no place in a picture.
            if is_due && posture.iter().all(|value| value.is_finite()) {
                course.push(posture);
                due_s = t_s + COURSE_SPACING_S;
            }
        }
        course
    }

    /// Commands from `from_s` on and before `until_s` \[s\].
    pub(crate) fn commands(&self, from_s: f64, until_s: f64) -> impl Iterator<Item = [f64; 4]> {
        let within = move |(t_s, _): &&(f64, [f64; 4])| (from_s..until_s).contains(t_s);
        self.commands.iter().filter(within).map(|(_, share)| *share)
    }

    /// Errors at every recorded state of the vehicle, in order of time. An error is 0 while there is no set
    /// point or reference yet.
    #[must_use]
    pub fn moments(&self) -> Vec<Moment> {
        let mut setpoints = self.setpoints.iter().peekable();
        let mut wanted = self.wanted.iter().peekable();
        let (mut setpoint, mut reference) = (None, None);
        let mut moments = Vec::with_capacity(self.motions.len());
        for motion in &self.motions {
            while let Some((_, gamma)) = setpoints.next_if(|(t_s, _)| *t_s <= motion.t_s) {
                setpoint = Some(quaternion_from_euler(&Vector3::from(*gamma)));
            }
            while let Some(next) = wanted.next_if(|wanted| wanted.t_s <= motion.t_s) {
                reference = Some(*next);
            }
            moments.push(moment(motion, setpoint, reference));
        }
        moments
    }
}

fn moment(
    motion: &Motion,
    setpoint: Option<UnitQuaternion<f64>>,
    reference: Option<Wanted>,
) -> Moment {
    let [w, x, y, z] = motion.q_wb;
    let q = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let up_b = q.inverse_transform_vector(&Vector3::z());
    let yaw_rad = libm::atan2(2.0 * (q.w * q.k + q.i * q.j), 1.0 - 2.0 * (q.j * q.j + q.k * q.k));
    let heading_rad = reference.map_or(0.0, |wanted| {
        let error_rad = yaw_rad - wanted.yaw_rad;
        libm::atan2(libm::sin(error_rad), libm::cos(error_rad)).abs()
    });
    let (position_m, velocity_m_s) = reference.map_or((0.0, 0.0), |wanted| {
        // Between two samples the reference is extrapolated at constant velocity.
        let age_s = motion.t_s - wanted.t_s;
        let velocity = Vector3::from(wanted.velocity_w_m_s);
        let position = Vector3::from(wanted.position_w_m) + velocity * age_s;
        let distance = Vector3::from(motion.position_w_m) - position;
        (distance.norm(), (Vector3::from(motion.velocity_w_m_s) - velocity).norm())
    });
    Moment {
        t_s: motion.t_s,
        tilt_rad: libm::atan2(libm::hypot(up_b.x, up_b.y), up_b.z),
        attitude_rad: setpoint.map_or(0.0, |setpoint| angle(&(setpoint.inverse() * q))),
        rate_rad_s: Vector3::from(motion.body_rate_b_rad_s).norm(),
        position_m,
        velocity_m_s,
        height_m: motion.position_w_m[2],
        heading_rad,
    }
}

/// Rotation angle 2 atan(|v| / |w|) \[rad\]. Only functions of `libm` and correctly rounded operations are
/// used, so that the result has the same bits on every machine.
fn angle(q: &UnitQuaternion<f64>) -> f64 {
    let vector = (q.i * q.i + q.j * q.j + q.k * q.k).sqrt();
    2.0 * libm::atan2(vector, q.w.abs())
}
