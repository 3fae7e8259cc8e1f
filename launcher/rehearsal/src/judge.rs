//! Compares the errors of the candidate in each window with those of the owner in the same flight.

use crate::limits::NOT_FINITE;
use crate::loss::Lost;
use crate::{
    Challenge, Facts, Figure, Limits, Measure, Moment, Posture, RehearsalFigures, RehearsalRefusal,
    Schedule, Track, Tube,
};
use shared_types::Slot;

/// Last part of a window, as a share of it, in which a good controller has recovered.
const REST_SHARE: f64 = 0.4;
/// Longest course to a loss that is kept \[s\].
const COURSE_S: f64 = 4.0;
/// Height below which the vehicle touches the ground, with a margin for legs and noise \[m\].
const GROUND_M: f64 = 0.05;

/// One initial state, flown with the candidate and with the owner.
#[derive(Debug, Clone, Copy)]
pub struct Flown<'a> {
    /// Number of the initial state: 0 for the mean, then the draws.
    pub draw: usize,
    /// Challenges of both flights.
    pub schedule: &'a Schedule,
    /// The flight with the candidate.
    pub candidate: &'a Track,
    /// The flight with the owner alone.
    pub owner: &'a Track,
}

/// The first loss of the vehicle from `from_s` \[s\] on, with its instant \[s\]; `None` if it was not lost.
/// `moments` are those of `track`.
#[must_use]
pub fn lost(
    track: &Track,
    moments: &[Moment],
    from_s: f64,
    (facts, tube): (&Facts, &Tube),
) -> Option<(f64, Lost)> {
    let of = |moment: &Moment| {
        let Moment { tilt_rad, position_m, height_m, .. } = *moment;
        let (limit_rad, limit_m) = (tube.tilt_max_rad, tube.excursion_max_m);
        if !(tilt_rad.is_finite() && position_m.is_finite() && height_m.is_finite()) {
            Some(Lost::NotFinite)
        } else if tilt_rad > limit_rad {
            Some(Lost::Tilted { tilt_rad, limit_rad })
        } else if !facts.is_rig && facts.ground && height_m < GROUND_M {
            Some(Lost::Grounded { height_m, limit_m: GROUND_M })
        } else if !facts.is_rig && position_m > 2.0 * limit_m {
            Some(Lost::Away { distance_m: position_m, limit_m: 2.0 * limit_m })
        } else {
            None
        }
    };
    let mut since = moments.iter().filter(|moment| moment.t_s >= from_s);
    let moved = since.find_map(|moment| Some((moment.t_s, of(moment)?)));
    let unguided = track.unguided_s().filter(|t_s| *t_s >= from_s);
    let unguided = unguided.map(|t_s| (t_s, Lost::Uncommanded));
    match (moved, unguided) {
        (Some(moved), Some(unguided)) if unguided.0 < moved.0 => Some(unguided),
        (Some(moved), _) => Some(moved),
        (None, unguided) => unguided,
    }
}

fn largest(moments: &[Moment], of: impl Fn(&Moment) -> f64) -> f64 {
    // NaN must count as the largest error, but `f64::max` would ignore it.
    let worse = |worst: f64, value: f64| if value.is_nan() { NOT_FINITE } else { worst.max(value) };
    moments.iter().map(of).fold(0.0, worse)
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    let mean: f64 = if count > 0.0 { sum / count } else { 0.0 };
    if mean.is_nan() { NOT_FINITE } else { mean.sqrt() }
}

/// Root mean square of the difference between successive commands, of the worst axis.
fn effort(commands: impl Iterator<Item = [f64; 4]>) -> f64 {
    let (mut sums, mut count, mut before) = ([0.0; 4], 0.0, None::<[f64; 4]>);
    for command in commands {
        if let Some(before) = before {
            for axis in 0..4 {
                let step: f64 = command[axis] - before[axis];
                sums[axis] += step * step;
            }
            count += 1.0;
        }
        before = Some(command);
    }
    if count == 0.0 {
        return 0.0;
    }
    sums.into_iter().fold(0.0, |worst, sum| {
        let mean: f64 = sum / count;
        if mean.is_nan() { NOT_FINITE } else { mean.sqrt().max(worst) }
    })
}

fn measured(
    measure: Measure,
    track: &Track,
    moments: &[Moment],
    (from_s, until_s): (f64, f64),
) -> f64 {
    let rest_s = until_s - REST_SHARE * (until_s - from_s);
    let at = |t_s: f64| moments.partition_point(|moment| moment.t_s < t_s);
    let (from, rest, until) = (at(from_s), at(rest_s), at(until_s));
    let (all, rest) = (&moments[from..until], &moments[rest..until]);
    match measure {
        Measure::Tilt => largest(all, |m| m.tilt_rad),
        Measure::AttitudePeak => largest(all, |m| m.attitude_rad),
        Measure::AttitudeRest => rms(rest.iter().map(|m| m.attitude_rad)),
        Measure::RateRest => rms(rest.iter().map(|m| m.rate_rad_s)),
        Measure::PositionPeak => largest(all, |m| m.position_m),
        Measure::PositionRest => rms(rest.iter().map(|m| m.position_m)),
        Measure::VelocityRest => rms(rest.iter().map(|m| m.velocity_m_s)),
        Measure::HeadingPeak => largest(all, |m| m.heading_rad),
        Measure::Effort => effort(track.commands(rest_s, until_s)),
    }
}

/// Measures every figure of the flights and compares it with its limit.
///
/// # Errors
/// If the vehicle would be lost with the candidate, or if one of its errors leaves the tube.
pub fn judge(
    slot: Slot,
    facts: &Facts,
    tube: &Tube,
    flights: &[Flown<'_>],
) -> Result<RehearsalFigures, Box<RehearsalRefusal>> {
    let limits = Limits::of(facts);
    let mut figures = RehearsalFigures { slot, figures: Vec::new(), lost: None };
    for flight in flights {
        let (moments, owners) = (flight.candidate.moments(), flight.owner.moments());
        let flip_s = flight.schedule.trials.first().map_or(0.0, |trial| trial.at_s);
        let loss = lost(flight.candidate, &moments, flip_s, (facts, tube));
        for trial in &flight.schedule.trials {
            if loss.is_some_and(|(t_s, _)| t_s < trial.at_s) {
                break;
            }
            let window = (trial.at_s, trial.until_s);
            for &measure in Measure::of(slot, facts.is_rig) {
                let envelope = tube.envelope(slot, measure, trial, (facts, &limits));
                let owner = measured(measure, flight.owner, &owners, window);
                figures.figures.push(Figure {
                    draw: flight.draw,
                    challenge: trial.challenge,
                    at_s: trial.at_s - flip_s,
                    measure,
                    candidate: measured(measure, flight.candidate, &moments, window),
                    owner,
                    envelope,
                    limit: tube.limit(envelope, owner),
                });
            }
        }
        if let Some((t_s, lost)) = loss {
            let after = flight.schedule.trials.iter().rev().find(|trial| trial.at_s <= t_s);
            let (challenge, at_s) =
                after.map_or((Challenge::Flip, flip_s), |trial| (trial.challenge, trial.at_s));
            let (draw, after_s) = (flight.draw, t_s - at_s);
            figures.lost = Some((draw, challenge, after_s, lost));
            return Err(Box::new(RehearsalRefusal::Lost {
                draw,
                challenge,
                after_s,
                lost,
                figures,
                course: flight.candidate.course(flip_s.max(t_s - COURSE_S), t_s),
            }));
        }
    }
    let worst = figures.worst().copied();
    match worst.filter(|figure| !figure.is_within()) {
        Some(figure) => {
            let course = course_after(&figure, flights);
            Err(Box::new(RehearsalRefusal::Outside { figure, figures, course }))
        }
        None => Ok(figures),
    }
}

/// Where the vehicle was in the window of a figure.
fn course_after(figure: &Figure, flights: &[Flown<'_>]) -> Vec<Posture> {
    let Some(flight) = flights.iter().find(|flight| flight.draw == figure.draw) else {
        return Vec::new();
    };
    let trials = &flight.schedule.trials;
    let flip_s = trials.first().map_or(0.0, |trial| trial.at_s);
    let trial = trials.iter().find(|trial| trial.at_s - flip_s >= figure.at_s - 1e-9);
    trial.map_or_else(Vec::new, |trial| {
        flight.candidate.course(trial.at_s.max(trial.until_s - COURSE_S), trial.until_s)
    })
}
