"""The vehicle as every controller models it."""

import math


class Vehicle:
    """What of the modelled vehicle a controller needs; made of `[vehicle]` in `flight.toml`."""

    def __init__(self, vehicle):
        self._vehicle = vehicle
        self.mass_kg = vehicle["mass_kg"]
        self.gravity_m_s2 = vehicle["gravity_m_s2"]
        self.weight_n = self.mass_kg * self.gravity_m_s2
        self.thrust_max_n = 4.0 * vehicle["rotor_thrust_max_n"]
        scale = vehicle["inertia_scale"]
        laws = ("inertia_xx_kg_m2", "inertia_yy_kg_m2", "inertia_zz_kg_m2")
        self._inertia = [[scale * c for c in vehicle[law]] for law in laws]

    def inertia_kg_m2(self, morph_angle_rad):
        """Principal inertia at a deployable angle."""
        degrees = degrees_of(morph_angle_rad)
        return [c0 + degrees * (c1 + degrees * c2) for c0, c1, c2 in self._inertia]

    def bound_nm(self, morph_angle_rad, thrust_n):
        """Largest torque that the rotors can give beside a thrust: two of them no more than half the
        weight and than they have at hover, the other two no less than nothing."""
        degrees = degrees_of(morph_angle_rad)
        c0, c1, c2 = self._vehicle["arm_length_m"]
        arm_m = c0 + degrees * (c1 + degrees * c2)
        spare_n = max(0.0, 2.0 * self._vehicle["rotor_thrust_max_n"] - 0.5 * self.weight_n)
        tilt_nm = arm_m * min(0.5 * self.weight_n, 0.5 * thrust_n, spare_n)
        yaw_nm = self._vehicle["yaw_coefficient_m"] * min(self.weight_n, 2.0 * spare_n)
        return (tilt_nm, tilt_nm, yaw_nm)


def degrees_of(morph_angle_rad):
    return min(max(math.degrees(morph_angle_rad), 45.0), 160.0)
