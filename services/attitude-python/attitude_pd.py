#!/usr/bin/env python3
"""An attitude controller in Python: takes the attitude slot of a flight.

    morphquad run figure8-morph --swap attitude=services/attitude-python/attitude_pd.py@6s

Angle error to body rate, rate error to torque (PD), and an integral that holds what is constantly
missing and makes the change of hands smooth. `host/` makes a process of a flight of it.
"""

import math

from host import attitude

GAINS = {
    "angle_per_s": [16.0, 16.0, 16.0],  # Body rate per angle error [1/s].
    "rate_per_s": [50.0, 50.0, 55.0],  # Angular acceleration per rate error [1/s].
    "integral_s": 0.5,  # Integral time of the rate error [s].
}


def quaternion_of(roll, pitch, yaw):
    """Hamilton quaternion, body to world, of intrinsic z-y-x angles [rad]."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a / 2), math.cos(a / 2)) for a in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def rotation_between(q, p):
    """The rotation [rad] in the body frame of q that leads to p, for small ones."""
    (a, b, c, d), (w, x, y, z) = q, p
    scalar = a * w + b * x + c * y + d * z
    sign = math.copysign(2.0, scalar)
    return (
        sign * (a * x - b * w - c * z + d * y),
        sign * (a * y + b * z - c * w - d * x),
        sign * (a * z - b * y + c * x - d * w),
    )


class AttitudePd:
    """The law, and everything of it that evolves."""

    def __init__(self, vehicle, period_s, gains):
        self.gains = gains
        self.share = period_s / gains["integral_s"]
        self.integral_nm = [0.0, 0.0, 0.0]

    def torque(self, sample):
        """Torque [N m] for the attitude that the position loop asks for."""
        q = sample.estimate.q_wb
        error_rad = rotation_between((q.w, q.x, q.y, q.z), quaternion_of(*sample.attitude_rad))
        rate_rad_s = sample.estimate.body_rate_b_rad_s
        torque_nm = []
        for axis in range(3):
            rate_error = self.gains["angle_per_s"][axis] * error_rad[axis] - rate_rad_s[axis]
            law = sample.inertia_kg_m2[axis] * self.gains["rate_per_s"][axis] * rate_error
            if sample.tracked_nm is not None:
                # The next torque continues from what the rotors were told.
                self.integral_nm[axis] = sample.tracked_nm[axis] - law
            wish, bound = law + self.integral_nm[axis], sample.bound_nm[axis]
            given = min(max(wish, -bound), bound)
            if (given - wish) * law >= 0.0:  # Beyond a bound it only comes back.
                self.integral_nm[axis] += self.share * law
            torque_nm.append(given)
        return torque_nm


if __name__ == "__main__":
    attitude.main("attitude_pd", AttitudePd, GAINS)
