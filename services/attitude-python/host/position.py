"""What surrounds the law of a position controller: state estimate and reference in, set point out."""

import math
import sys
import typing

from . import process
from .reference import landing_at
from .vehicle import Vehicle

INPUTS = ("state_estimate", "reference", "applied_setpoint", "applied_command", "attitude_owner")
OUTPUTS = ("attitude_setpoint", "position_report")
# Largest roll and pitch [rad]; least and largest thrust over the weight.
TILT_MAX_RAD = 0.35
THRUST_WEIGHTS = (0.3, 2.0)
FREE = (math.inf, math.inf, math.inf)


class Sample(typing.NamedTuple):
    """What a position law knows at a step, in W."""

    t_ns: int
    position_m: tuple
    velocity_m_s: tuple
    # Where to be, how to move, and how that changes.
    target_m: tuple
    target_m_s: tuple
    target_m_s2: tuple
    # Acceleration from which the next one is to continue [m/s^2]; None unless the controller shadows
    # another one.
    tracked_m_s2: typing.Any


class Position:
    """A position loop around a law: `law.acceleration(sample)` [m/s^2] in W, and afterwards
    `law.applied(sample, wish, given)` with what was wished for and what the bounds left of it."""

    def __init__(self, law, vehicle, flight):
        self._law, self._vehicle, self._hover_s = law, vehicle, flight["hover_s"]
        self._bounds_n = tuple(weights * vehicle.weight_n for weights in THRUST_WEIGHTS)
        # Pitch and roll at heading zero [rad], and thrust [N].
        self._command = (0.0, 0.0, vehicle.weight_n)
        # Set point that the attitude loop in command follows: roll, pitch, thrust.
        self._followed = None

    def step(self, t_ns, loop):
        """Fills in the outputs of a step; gives the names of those to send."""
        self._take_followed(loop)
        estimate, reference = loop.inputs["state_estimate"].value, loop.inputs["reference"].value
        limit_ns = 2 * loop.rate.period_ns
        if estimate is None or reference is None or t_ns > estimate.described_ns + limit_ns:
            return ()  # The attitude loop holds the last set point, and flies by itself if none follows.
        q = estimate.q_wb
        heading_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
        target, yaw_rad = self._target(reference, t_ns)
        sample = Sample(
            t_ns,
            tuple(estimate.position_w_m),
            tuple(estimate.velocity_w_m_s),
            *target,
            self._tracked(loop, heading_rad),
        )
        wish = process.three_numbers("acceleration(sample)", self._law.acceleration(sample))
        previous, self._command = self._command, self._bounded(wish)
        self._law.applied(sample, wish, self._acceleration_of(self._command))
        self._fill_in(loop, previous, heading_rad, yaw_rad)
        return OUTPUTS

    def _target(self, reference, t_ns):
        """Position, velocity and acceleration to have now, and the heading."""
        position, velocity, ahead, yaw_rad = landing_at(reference, t_ns, self._hover_s)
        return (position, velocity, ahead), yaw_rad

    def _take_followed(self, loop):
        """Notes what the attitude loop in command follows; shadows report what they would, too."""
        owners, applied = loop.inputs["attitude_owner"], loop.inputs["applied_setpoint"]
        plant = loop.inputs["applied_command"].value
        # Without a fallback the gate flies after a trip, until the owner is followed again.
        is_held = plant is not None and plant.tripped and plant.command_sequence == 0
        has_failed = is_held or (plant is not None and plant.failed_over)
        known = [owners.value_of(one) for one in (owners.before, *owners.fresh) if one is not None]
        for standing in ("owner", "fallback"):
            for sample in reversed(applied.fresh):
                judges = [record for record in known if record.header.valid_ns <= sample.valid_ns]
                if judges and getattr(judges[-1], standing) == sample.seat:
                    if standing == "owner" and has_failed and plant.epoch == judges[-1].epoch:
                        break
                    report = applied.value_of(sample)
                    if report.setpoint_sequence > 0:
                        self._followed = (report.roll_rad, report.pitch_rad, report.thrust_n)
                    return

    def _tracked(self, loop, heading_rad):
        if not loop.is_tracking or self._followed is None:
            return None
        roll_rad, pitch_rad, thrust_n = self._followed
        self._command = (*turned(pitch_rad, roll_rad, heading_rad), thrust_n)
        return self._acceleration_of(self._command)

    def _bounded(self, acceleration):
        """Pitch, roll and thrust for an acceleration, within bounds."""
        x, y, z = acceleration
        gravity = self._vehicle.gravity_m_s2
        lift = max(z + gravity, 0.1 * gravity)
        pitch, roll = (
            min(max(math.atan2(a, lift), -TILT_MAX_RAD), TILT_MAX_RAD) for a in (x, -y)
        )
        thrust_n = self._vehicle.mass_kg * lift / (math.cos(pitch) * math.cos(roll))
        least, most = self._bounds_n
        return pitch, roll, min(max(thrust_n, least), most)

    def _acceleration_of(self, command):
        """The acceleration of a command: the reverse of `_bounded` inside the bounds."""
        pitch, roll, thrust_n = command
        lift = thrust_n * math.cos(pitch) * math.cos(roll) / self._vehicle.mass_kg
        gravity = self._vehicle.gravity_m_s2
        return math.tan(pitch) * lift, -math.tan(roll) * lift, lift - gravity

    def _fill_in(self, loop, previous, heading_rad, yaw_rad):
        pitch, roll, thrust_n = self._command
        setpoint = loop.outputs["attitude_setpoint"].value
        setpoint.pitch_rad, setpoint.roll_rad = turned(pitch, roll, -heading_rad)
        setpoint.thrust_n, setpoint.yaw_rad = thrust_n, yaw_rad
        report = loop.outputs["position_report"].value
        least, most = self._bounds_n
        for name, values in (
            ("input", self._command),
            ("previous_input", previous),
            ("input_min", (-TILT_MAX_RAD, -TILT_MAX_RAD, least)),
            ("input_max", (TILT_MAX_RAD, TILT_MAX_RAD, most)),
            ("increment_max", FREE),
        ):
            field = getattr(report, name)
            field.pitch_rad, field.roll_rad, field.thrust_n = values


def turned(pitch, roll, heading):
    """Pitch and roll at heading zero from those at a heading, and with `-heading` the way back."""
    s, c = math.sin(heading), math.cos(heading)
    return c * pitch + s * roll, c * roll - s * pitch


def main(name, law, gains):
    """Flies `law(vehicle, period_s, gains)` in the position slot; `--config FILE` changes gains."""

    def begin(host):
        own = process.configured(host.options.config, gains)
        vehicle = Vehicle(host.flight["vehicle"])
        made = law(vehicle, 1.0 / host.graph.rates["position"].hz, own)
        return Position(made, vehicle, host.flight), (INPUTS, OUTPUTS)

    sys.exit(process.main(name, "a position controller of a morphquad run", "position", begin))


def fly(acceleration):
    """Flies a law without gains or memory of its own, `acceleration(sample)` [m/s^2] in W, in the position slot."""
    main(process.own_name(), lambda _vehicle, _period_s, _gains: Law(acceleration), {})


class Law(typing.NamedTuple):
    """A law that is one function, and ignores how far the bounds have limited it."""

    acceleration: typing.Callable

    def applied(self, sample, wish, given):
        """Nothing in it evolves."""
