//! What a rehearsed flight left: where the vehicle was, what was asked of it, what was commanded.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use vehicle::quaternion_from_euler;

/// The vehicle of the rehearsal at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The instant \[s\].
    pub t_s: f64,
    /// Position \[m\].
    pub position_w_m: [f64; 3],
    /// Velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
    /// Attitude, body to world: w, x, y, z.
    pub q_wb: [f64; 4],
    /// Body rate \[rad/s\].
    pub body_rate_b_rad_s: [f64; 3],
}

/// What the position reference asks for from an instant on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// The instant \[s\].
    pub t_s: f64,
    /// Position \[m\].
    pub position_w_m: [f64; 3],
    /// Velocity \[m/s\].
    pub velocity_w_m_s: [f64; 3],
}

/// Everything that is kept of a flight.
#[derive(Debug, Clone, Default)]
pub struct Track {
    motions: Vec<Motion>,
    wanted: Vec<Wanted>,
    /// Instant \[s\], φ, θ, ψ \[rad\].
    setpoints: Vec<(f64, [f64; 3])>,
    /// Instant \[s\] and command over the largest one, of whoever commands the slot.
    commands: Vec<(f64, [f64; 4])>,
    /// First instant at which the actuation guard commanded instead \[s\].
    unguided_s: Option<f64>,
}

/// Errors at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The instant \[s\].
    pub t_s: f64,
    /// Angle between body z and up \[rad\].
    pub tilt_rad: f64,
    /// Angle of the rotation from the set point to the attitude \[rad\].
    pub attitude_rad: f64,
    /// Length of the body rate \[rad/s\].
    pub rate_rad_s: f64,
    /// Distance from the reference \[m\].
    pub position_m: f64,
    /// Length of the velocity's error \[m/s\].
    pub velocity_m_s: f64,
    /// Height \[m\].
    pub height_m: f64,
}

impl Track {
    /// The vehicle has moved.
    pub fn moved(&mut self, motion: Motion) {
        self.motions.push(motion);
    }

    /// The reference asks for this from its instant on.
    pub fn wants(&mut self, wanted: Wanted) {
        self.wanted.push(wanted);
    }

    /// The attitude loop tracks φ, θ, ψ \[rad\] from `t_s` on.
    pub fn tracks(&mut self, t_s: f64, gamma_rad: [f64; 3]) {
        self.setpoints.push((t_s, gamma_rad));
    }

    /// A command of the owner, each component over the largest one.
    pub fn commanded(&mut self, t_s: f64, share: [f64; 4]) {
        self.commands.push((t_s, share));
    }

    /// The actuation guard levels the vehicle or has cut the rotors.
    pub fn unguided(&mut self, t_s: f64) {
        self.unguided_s.get_or_insert(t_s);
    }

    /// First instant at which the actuation guard commanded instead \[s\].
    #[must_use]
    pub fn unguided_s(&self) -> Option<f64> {
        self.unguided_s
    }

    /// Commands within a stretch of time.
    pub(crate) fn commands(&self, from_s: f64, until_s: f64) -> impl Iterator<Item = [f64; 4]> {
        let within = move |(t_s, _): &&(f64, [f64; 4])| (from_s..until_s).contains(t_s);
        self.commands.iter().filter(within).map(|(_, share)| *share)
    }

    /// Errors at every instant at which the vehicle was seen, in order of time.
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
    let (position_m, velocity_m_s) = reference.map_or((0.0, 0.0), |wanted| {
        // Between two samples the reference moves on.
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
    }
}

/// 2 atan(|v| / |w|), by functions whose bits are the same on every machine.
fn angle(q: &UnitQuaternion<f64>) -> f64 {
    let vector = (q.i * q.i + q.j * q.j + q.k * q.k).sqrt();
    2.0 * libm::atan2(vector, q.w.abs())
}
