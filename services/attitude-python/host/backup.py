"""The position law of an attitude loop whose set points have ended: it follows the reference.

Proportional in position and velocity, beside the reference's acceleration. It has no integral and knows neither wind nor
drag; what the last set point asked for beyond it is what holds against them, and fades.
"""

import math

from .reference import landing_at

# Velocity per position error [1/s], and the largest one that it asks for [m/s].
POSITION_GAIN_S, SPEED_MAX_M_S = 2.2, 1.0
# Acceleration per velocity error [1/s].
VELOCITY_GAIN_S = 5.5
# Bound on the tilt that a position loop asks for [rad], largest share of the weight by which the law's thrust differs
# from it, and thrust in weights of any set point here.
TILT_BOUND_RAD, LIFT_MAX, THRUST_WEIGHTS = 0.35, 0.5, (0.3, 2.0)


def backup_of(t_ns, vehicle, yaw_rad, estimate, reference):
    """What is followed without a set point: thrust [N], roll, pitch and yaw [rad] that keep the vehicle on the reference,
    or bring it to rest without one. Without a finite estimate that is level, and carries the weight."""
    motion = None if reference is None else landing_at(reference, t_ns)
    if motion and not all(map(math.isfinite, (*motion[0], *motion[1], *motion[2], motion[3]))):
        motion = None
    wanted = None if estimate is None else in_heading(estimate.q_wb, acceleration_of(estimate, motion))
    ahead, left, up = (part / vehicle.gravity_m_s2 for part in wanted or (0.0, 0.0, 0.0))
    roll_rad, pitch_rad = -bounded(left, TILT_BOUND_RAD), bounded(ahead, TILT_BOUND_RAD)
    lift = 1.0 + bounded(up, LIFT_MAX)
    by_tilt = 1.0 + 0.5 * (roll_rad**2 + pitch_rad**2)
    return (vehicle.weight_n * lift * by_tilt, roll_rad, pitch_rad, motion[3] if motion else yaw_rad)


def acceleration_of(estimate, motion):
    """Acceleration in W towards a motion, or to rest without one [m/s^2]."""
    speeds_m_s = estimate.velocity_w_m_s
    if motion is None:
        return tuple(-VELOCITY_GAIN_S * speed for speed in speeds_m_s)
    position, velocity, ahead, _ = motion
    return tuple(
        a + VELOCITY_GAIN_S * (v + bounded(POSITION_GAIN_S * (p - is_), SPEED_MAX_M_S) - speed)
        for p, v, a, is_, speed in zip(position, velocity, ahead, estimate.position_w_m, speeds_m_s)
    )


def together(law, excess, before, vehicle):
    """Thrust, roll and pitch of the law with what is left of a last set point, within what a set point may ask for, or what
    was followed before, where that is more: nothing jumps."""
    thrust_n, *angles_rad = (own + more for own, more in zip(law, excess))
    least, most = (weights * vehicle.weight_n for weights in THRUST_WEIGHTS)
    tilts = (bounded(angle, max(TILT_BOUND_RAD, abs(was))) for angle, was in zip(angles_rad, before[1:3]))
    return (min(max(thrust_n, min(least, before[0])), max(most, before[0])), *tilts)


def bounded(value, most):
    """A value within plus and minus `most`."""
    return min(max(value, -most), most)


def in_heading(q, vector):
    """A vector of W as its parts ahead and to the left of the vehicle's heading, and up; None if one is not finite."""
    east, north, up = vector
    cosine, sine = 1.0 - 2.0 * (q.y**2 + q.z**2), 2.0 * (q.x * q.y + q.w * q.z)
    length = math.hypot(cosine, sine) or math.nan
    ahead, left = (cosine * east + sine * north) / length, (cosine * north - sine * east) / length
    return (ahead, left, up) if all(map(math.isfinite, (ahead, left, up))) else None
