#!/usr/bin/env python3
"""A position controller in Python: takes the position slot of a flight.

    morphquad run figure8-morph --swap position=services/attitude-python/position_pd.py@6s

Position and velocity errors to acceleration (PD), beside that of the reference, and an integral that holds
what is constantly missing and makes the change of hands smooth. `host/` turns the thrust into that direction.
"""

from host import position

GAINS = {
    "position_per_s2": [20.0, 20.0, 40.0],  # Acceleration per position error [1/s^2].
    "velocity_per_s": [5.5, 5.5, 8.0],  # Acceleration per velocity error [1/s].
    "integral_s": 1.2,  # Integral time of the position error [s].
}


class PositionPd:
    """The law, and everything of it that evolves."""

    def __init__(self, vehicle, period_s, gains):
        self.gains = gains
        self.share = period_s / gains["integral_s"]
        self.integral_m_s2 = [0.0, 0.0, 0.0]

    def acceleration(self, sample):
        """Acceleration in W [m/s^2] towards the reference."""
        law = []
        for axis in range(3):
            error_m = sample.target_m[axis] - sample.position_m[axis]
            error_m_s = sample.target_m_s[axis] - sample.velocity_m_s[axis]
            position_gain = self.gains["position_per_s2"][axis]
            velocity_gain = self.gains["velocity_per_s"][axis]
            wanted = sample.target_m_s2[axis]
            law.append(wanted + position_gain * error_m + velocity_gain * error_m_s)
        if sample.tracked_m_s2 is not None:
            # The next acceleration continues from the one that is flown.
            self.integral_m_s2 = [flown - own for flown, own in zip(sample.tracked_m_s2, law)]
        return [own + integral for own, integral in zip(law, self.integral_m_s2)]

    def applied(self, sample, wish, given):
        """Integrates; an axis that a bound has cut only comes back."""
        for axis in range(3):
            error_m = sample.target_m[axis] - sample.position_m[axis]
            further = self.share * self.gains["position_per_s2"][axis] * error_m
            cut = given[axis] - wish[axis]
            if abs(cut) < 1e-9 or cut * further > 0.0:
                self.integral_m_s2[axis] += further


if __name__ == "__main__":
    position.main("position_pd", PositionPd, GAINS)
