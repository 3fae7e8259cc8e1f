"""The two laws and what surrounds them, step by step and without a flight."""

import math
import pathlib
import sys
import types
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import attitude_pd  # noqa: E402
import position_pd  # noqa: E402
from host.attitude import Attitude  # noqa: E402
from host.position import TILT_MAX_RAD, Position  # noqa: E402
from host.vehicle import Vehicle  # noqa: E402

VEHICLE = Vehicle(
    {
        "mass_kg": 0.12,
        "gravity_m_s2": 9.81,
        "rotor_thrust_max_n": 1.0,
        "inertia_scale": 1.0,
        "yaw_coefficient_m": 0.016,
        "arm_length_m": [0.1, 0.0, 0.0],
        "inertia_xx_kg_m2": [1e-3, 0.0, 0.0],
        "inertia_yy_kg_m2": [1e-3, 0.0, 0.0],
        "inertia_zz_kg_m2": [2e-3, 0.0, 0.0],
    }
)
SAMPLES = types.SimpleNamespace(
    NO_SEAT=2**32 - 1,
    GateMode=types.SimpleNamespace(Recover=4),
    Role=types.SimpleNamespace(Position=2),
)
Fields = types.SimpleNamespace


class Taken:
    """An input with one value."""

    def __init__(self, value=None, fresh=(), before=None):
        self.value, self.fresh, self.before = value, list(fresh), before

    def value_of(self, sample):
        return sample.value


def estimate(roll_rad=0.0, position_m=(0.0, 0.0, 0.0)):
    return Fields(
        described_ns=0,
        q_wb=Fields(w=math.cos(roll_rad / 2), x=math.sin(roll_rad / 2), y=0.0, z=0.0),
        body_rate_b_rad_s=(0.0, 0.0, 0.0),
        morph_angle_rad=1.0,
        position_w_m=position_m,
        velocity_w_m_s=(0.0, 0.0, 0.0),
    )


def loop(period_ms, inputs, is_tracking, outputs):
    return Fields(
        rate=Fields(period_ns=period_ms * 1_000_000),
        inputs=inputs,
        outputs={name: Fields(value=Fields(**fields)) for name, fields in outputs.items()},
        is_tracking=is_tracking,
    )


class AttitudeLaw(unittest.TestCase):
    def torque(self, roll_rad, applied_nm=None):
        law = attitude_pd.AttitudePd(VEHICLE, 0.01, attitude_pd.GAINS)
        attitude = Attitude(law, VEHICLE, {"start_yaw_rad": 0.0}, SAMPLES)
        applied = applied_nm and Fields(command_sequence=1, torque_b_nm=applied_nm, mode=0)
        inputs = {
            "state_estimate": Taken(estimate(roll_rad)),
            "attitude_setpoint": Taken(),
            "applied_command": Taken(applied),
            "position_owner": Taken(),
            "trip": Taken(),
            "reference": Taken(),
        }
        names = ("wrench_command", "applied_setpoint", "attitude_report")
        step = loop(10, inputs, applied is not None, dict.fromkeys(names, {}))
        self.assertEqual(attitude.step(0, step), names)
        wrench = step.outputs["wrench_command"].value
        self.assertAlmostEqual(wrench.thrust_n, VEHICLE.weight_n)
        return wrench.torque_b_nm

    def test_a_roll_is_answered_against_it_and_never_beyond_the_bound(self):
        bound_nm = VEHICLE.bound_nm(1.0, VEHICLE.weight_n)[0]
        for roll_rad in (0.01, -0.01, 1.0, -1.0):
            x, y, z = self.torque(roll_rad)
            self.assertLess(x * roll_rad, 0.0)
            self.assertLessEqual(abs(x), bound_nm)
            self.assertAlmostEqual(abs(y) + abs(z), 0.0)

    def test_after_tracking_the_next_torque_is_the_applied_one(self):
        applied_nm = (0.004, -0.003, 0.001)
        for next_nm, wanted_nm in zip(self.torque(0.02, applied_nm), applied_nm):
            self.assertAlmostEqual(next_nm, wanted_nm, places=12)

    def test_without_a_fresh_estimate_nothing_is_commanded(self):
        law = attitude_pd.AttitudePd(VEHICLE, 0.01, attitude_pd.GAINS)
        attitude = Attitude(law, VEHICLE, {"start_yaw_rad": 0.0}, SAMPLES)
        silent = ("attitude_setpoint", "position_owner", "trip", "reference")
        inputs = {name: Taken() for name in silent}
        inputs["state_estimate"] = Taken(estimate())
        self.assertEqual(attitude.step(20_000_001, loop(10, inputs, False, {})), ())


class PositionLaw(unittest.TestCase):
    # What the plant reports about the seat that it follows.
    plant = None

    def position(self):
        law = position_pd.PositionPd(VEHICLE, 0.02, position_pd.GAINS)
        return Position(law, VEHICLE, {"hover_s": 2.0})

    def step(self, target_m, followed=None, position=None):
        """Pitch, roll and thrust of the set point, from rest at the origin."""
        point = Fields(position_w_m=target_m, velocity_w_m_s=(0.0, 0.0, 0.0), yaw_rad=0.0)
        reference = Fields(header=Fields(valid_ns=0), spacing_ns=10**9, count=1, points=[point])
        owner = Fields(value=Fields(header=Fields(valid_ns=0), epoch=2, owner=0, fallback=7))
        applied = [] if followed is None else [Fields(valid_ns=0, seat=0, value=followed)]
        inputs = {
            "state_estimate": Taken(estimate()),
            "reference": Taken(reference),
            "applied_setpoint": Taken(fresh=applied),
            "applied_command": Taken(self.plant),
            "attitude_owner": Taken(fresh=[owner]),
        }
        names = ("input", "previous_input", "input_min", "input_max", "increment_max")
        report = {name: Fields() for name in names}
        outputs = {"attitude_setpoint": {}, "position_report": report}
        step = loop(20, inputs, followed is not None, outputs)
        (position or self.position()).step(0, step)
        setpoint = step.outputs["attitude_setpoint"].value
        return setpoint.pitch_rad, setpoint.roll_rad, setpoint.thrust_n

    def test_it_leans_towards_where_it_is_to_be_and_never_beyond_its_bounds(self):
        for metres in (0.1, -0.1, 100.0, -100.0):
            pitch, roll, _ = self.step((metres, metres, 0.0))
            self.assertGreater(pitch * metres, 0.0)
            self.assertLess(roll * metres, 0.0)
            self.assertLessEqual(max(abs(pitch), abs(roll)), TILT_MAX_RAD)
            weights = self.step((0.0, 0.0, metres))[2] / VEHICLE.weight_n
            self.assertGreater((weights - 1.0) * metres, 0.0)
            self.assertTrue(0.3 <= weights <= 2.0)

    def test_after_tracking_the_next_set_point_is_the_applied_one(self):
        followed = Fields(setpoint_sequence=1, roll_rad=0.05, pitch_rad=-0.1, thrust_n=1.3)
        pitch, roll, thrust_n = self.step((0.3, -0.2, 0.1), followed)
        self.assertAlmostEqual(pitch, -0.1)
        self.assertAlmostEqual(roll, 0.05)
        self.assertAlmostEqual(thrust_n, 1.3)

    def test_an_owner_that_the_plant_has_left_is_not_believed(self):
        followed = Fields(setpoint_sequence=1, roll_rad=0.05, pitch_rad=-0.1, thrust_n=1.3)
        for epoch, failed_over, tripped, command_sequence, is_followed in (
            (2, True, False, 1, False),
            (2, False, True, 0, False),
            (2, False, True, 1, True),
            (2, False, False, 0, True),
            (1, True, True, 0, True),
        ):
            self.plant = Fields(
                epoch=epoch,
                failed_over=failed_over,
                tripped=tripped,
                command_sequence=command_sequence,
            )
            thrust_n = self.step((0.0, 0.0, 0.0), followed)[2]
            self.assertEqual(abs(thrust_n - 1.3) < 1e-6, is_followed)

    def test_without_a_new_reference_it_lands_without_a_jump(self):
        moving = [
            Fields(
                position_w_m=(0.05 * index, 0.0, 1.5), velocity_w_m_s=(1.0, 0.0, 0.0), yaw_rad=0.0
            )
            for index in range(48)
        ]
        header = Fields(valid_ns=0)
        reference = Fields(header=header, spacing_ns=50_000_000, count=48, points=moving)
        position, before = self.position(), None
        for age_ns in range(1_900_000_000, 6_000_000_000, 20_000_000):
            ((x, _, z), (_, _, climb_m_s), _), _ = position._target(reference, age_ns)
            self.assertAlmostEqual(x, min(age_ns * 1e-9, 2.35))
            self.assertAlmostEqual(z, max(0.0, 1.5 - 0.5 * max(0.0, age_ns * 1e-9 - 2.0)))
            if before is not None:
                self.assertLess(abs(z - before), 0.011)
            self.assertEqual(climb_m_s, -0.5 if 2.0 < age_ns * 1e-9 < 5.0 else 0.0)
            before = z

    def test_a_parabola_of_the_reference_is_met_between_its_points(self):
        def point(t):
            return Fields(
                position_w_m=(t * t, 1.0 - t, 0.0), velocity_w_m_s=(2 * t, -1.0, 0.0), yaw_rad=t
            )

        points = [point(0.02 * index) for index in range(48)]
        header = Fields(valid_ns=10**9)
        reference = Fields(header=header, spacing_ns=20_000_000, count=48, points=points)
        (position, velocity, acceleration), _ = self.position()._target(reference, 1_113_000_000)
        for got, wanted in zip(
            (*position, *velocity, *acceleration),
            (0.012769, 0.887, 0.0, 0.226, -1.0, 0.0, 2.0, 0.0, 0.0),
        ):
            self.assertAlmostEqual(got, wanted)
        # Two seconds after its end the vehicle sinks.
        (position, velocity, _), _ = self.position()._target(reference, 1_113_000_000 + 10**10)
        self.assertEqual((position[2], velocity), (0.0, (0.0, 0.0, 0.0)))


if __name__ == "__main__":
    unittest.main()
