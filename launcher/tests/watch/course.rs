//! What is flown: the reference, the arms and the wind over time.

use nalgebra::Vector3;

/// What is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Course {
    Hover,
    Figure8,
    Sweep,
    Gusts,
}

pub(crate) const COURSES: [Course; 4] =
    [Course::Hover, Course::Figure8, Course::Sweep, Course::Gusts];

/// Position and velocity of the reference.
pub(crate) fn course_at(course: Course, t_s: f64) -> [Vector3<f64>; 2] {
    let centre = Vector3::new(0.0, 0.0, 1.5);
    if course != Course::Figure8 {
        return [centre, Vector3::zeros()];
    }
    // The shipped figure eight, entered within two seconds.
    let w = core::f64::consts::TAU / 8.0;
    let at = |t_s: f64| {
        let grown = (t_s / 2.0).clamp(0.0, 1.0);
        let share = grown * grown * (3.0 - 2.0 * grown);
        let phase = w * t_s;
        let offset =
            Vector3::new(2.0 * libm::sin(phase), libm::sin(2.0 * phase), 0.5 * libm::sin(phase));
        centre + offset * share
    };
    [at(t_s), (at(t_s + 1e-4) - at(t_s - 1e-4)) / 2e-4]
}

pub(crate) fn morph_at(course: Course, t_s: f64) -> f64 {
    let swept = match course {
        Course::Figure8 => ((t_s - 2.0) / 1.5).clamp(0.0, 1.0),
        Course::Sweep => ((t_s - 2.5) / 0.5).clamp(0.0, 1.0) - ((t_s - 4.5) / 0.5).clamp(0.0, 1.0),
        _ => 0.0,
    };
    (45.0 + 115.0 * swept).to_radians()
}

pub(crate) fn gust_at(course: Course, t_s: f64, seed: u64) -> [f64; 3] {
    if course != Course::Gusts && course != Course::Figure8 {
        return [0.0; 3];
    }
    // A mean and three gusts of a tenth of the weight at most.
    let phase = seed as f64;
    let sum = |shift: f64| {
        let waves = [(0.9, 0.4), (2.3, 0.35), (5.1, 0.25)];
        waves.iter().map(|(w, a)| a * libm::sin(w * t_s + shift * w + phase)).sum::<f64>()
    };
    let scale = if course == Course::Gusts { 0.12 } else { 0.06 };
    [scale * (sum(0.0) + 0.4), scale * sum(1.7), 0.3 * scale * sum(3.1)]
}
