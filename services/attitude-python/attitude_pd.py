#!/usr/bin/env python3
"""An attitude controller in Python: takes the attitude slot of a flight.

    morphquad run figure8-morph --swap attitude=services/attitude-python/attitude_pd.py@6s

Angle error to body rate, rate error to torque (PD), and an integral that holds what is constantly
missing and makes the change of hands smooth. `host/` makes a process of a flight of it.
"""

from host import attitude

GAINS = {
    "angle_per_s": [16.0, 16.0, 16.0],  # Body rate per angle error [1/s].
    "rate_per_s": [50.0, 50.0, 55.0],  # Angular acceleration per rate error [1/s].
    "integral_s": 0.5,  # Integral time of the rate error [s].
}


class AttitudePd:
    """The law, and everything of it that evolves."""

    def __init__(self, vehicle, period_s, gains):
        self.gains = gains
        self.share = period_s / gains["integral_s"]
        self.integral_nm = [0.0, 0.0, 0.0]

    def torque(self, sample):
        """Torque [N m] for the attitude that the position loop asks for."""
        rate_rad_s = sample.estimate.body_rate_b_rad_s
        torque_nm = []
        for axis in range(3):
            rate_error = self.gains["angle_per_s"][axis] * sample.error_rad[axis] - rate_rad_s[axis]
            law = sample.inertia_kg_m2[axis] * self.gains["rate_per_s"][axis] * rate_error
            if sample.tracked_nm is not None:
                # The next torque continues from what the rotors were commanded.
                self.integral_nm[axis] = sample.tracked_nm[axis] - law
            wish, bound = law + self.integral_nm[axis], sample.bound_nm[axis]
            given = min(max(wish, -bound), bound)
            if (given - wish) * law >= 0.0:  # Beyond a bound it only comes back.
                self.integral_nm[axis] += self.share * law
            torque_nm.append(given)
        return torque_nm


if __name__ == "__main__":
    attitude.main("attitude_pd", AttitudePd, GAINS)
