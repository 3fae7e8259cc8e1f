"""What surrounds the law of an attitude controller: state estimate and set point in, torque out."""

import math
import sys
import typing

from . import process
from .arbiter import SetPoints
from .vehicle import Vehicle

INPUTS = ("state_estimate", "attitude_setpoint", "applied_command", "position_owner", "trip", "reference")
OUTPUTS = ("wrench_command", "applied_setpoint", "attitude_report")
# An estimate older than this, and than two periods, is not flown on [ns].
STALE_NS = 20_000_000
UNLIMITED = (math.inf, math.inf, math.inf)


class Sample(typing.NamedTuple):
    """What an attitude law knows at a step."""

    t_ns: int
    # The newest state estimate; q_wb and body_rate_b_rad_s are the fields that a law needs most.
    estimate: typing.Any
    # Rotation in the body frame to the attitude to take [rad], for small ones.
    error_rad: tuple
    # Roll, pitch and yaw to take [rad], and collective thrust beside the torque [N].
    attitude_rad: tuple
    thrust_n: float
    # Principal inertia [kg m^2], and largest torque that the rotors can give now [N m].
    inertia_kg_m2: list
    bound_nm: tuple
    # Torque from which the next one is to continue [N m]; None unless the controller shadows another, or
    # the actuation guard brings the vehicle back by itself.
    tracked_nm: typing.Any


class Attitude:
    """An attitude loop around a law, which is called as `law.torque(sample)`."""

    def __init__(self, law, vehicle, flight, samples):
        self._law, self._vehicle, self._no_seat = law, vehicle, samples.NO_SEAT
        self._recover = samples.GateMode.Recover
        self._setpoints = SetPoints(vehicle, samples.Role.Position)
        self._angles_rad = (0.0, 0.0, flight["start_yaw_rad"])
        self._thrust_n = vehicle.weight_n
        self._followed = 0
        self._torque_nm = (0.0, 0.0, 0.0)

    def step(self, t_ns, loop):
        """Fills in the outputs of a step; gives the names of those to send."""
        self._take_setpoint(t_ns, loop)
        estimate = loop.inputs["state_estimate"].value
        limit_ns = max(2 * loop.rate.period_ns, STALE_NS)
        if estimate is None or t_ns > estimate.described_ns + limit_ns:
            return ()  # The command lapses, and the plant's gate holds and levels by itself.
        vehicle, angle_rad = self._vehicle, estimate.morph_angle_rad
        thrust_n = min(max(self._thrust_n, 0.0), vehicle.thrust_max_n)
        bound_nm = vehicle.bound_nm(angle_rad, thrust_n)
        q = estimate.q_wb
        error_rad = rotation_between((q.w, q.x, q.y, q.z), quaternion_of(*self._angles_rad))
        sample = Sample(
            t_ns,
            estimate,
            error_rad,
            self._angles_rad,
            thrust_n,
            vehicle.inertia_kg_m2(angle_rad),
            bound_nm,
            self._tracked(loop),
        )
        torque_nm = process.three_numbers("torque(sample)", self._law.torque(sample))
        self._fill_in(loop, thrust_n, torque_nm, bound_nm)
        self._torque_nm = torque_nm
        return OUTPUTS

    def _take_setpoint(self, t_ns, loop):
        """Takes the set point that counts, or what stands in for one; the last one stays if there is neither."""
        setpoints = loop.inputs["attitude_setpoint"]
        owners, trips = loop.inputs["position_owner"], loop.inputs["trip"]
        estimate, reference = loop.inputs["state_estimate"].value, loop.inputs["reference"].value
        command = self._setpoints.take(t_ns, owners, setpoints, trips, estimate, reference)
        if command is not None:
            self._thrust_n, *angles_rad = command.value
            self._angles_rad, self._followed = tuple(angles_rad), command.sequence
        elif loop.is_tracking and self._followed == 0 and setpoints.value is not None:
            # A shadow that has just come: the first set point of its own is yet to be sent.
            asked = setpoints.value
            self._thrust_n = asked.thrust_n
            self._angles_rad = (asked.roll_rad, asked.pitch_rad, asked.yaw_rad)

    def _tracked(self, loop):
        """The torque last commanded, for a law that is to continue from it. What the actuation guard commands, to bring
        the vehicle back, is not what any law would: an integral that continued from that would stand in the way
        of the law's own torque for as long as its integral time."""
        applied = loop.inputs["applied_command"].value
        if not loop.is_tracking or applied is None or applied.command_sequence == 0:
            return None
        return None if applied.mode == self._recover else tuple(applied.torque_b_nm)

    def _fill_in(self, loop, thrust_n, torque_nm, bound_nm):
        wrench = loop.outputs["wrench_command"].value
        wrench.thrust_n, wrench.torque_b_nm = thrust_n, torque_nm
        wrench.validity_ns = 2 * loop.rate.period_ns
        applied = loop.outputs["applied_setpoint"].value
        applied.setpoint_sequence, applied.thrust_n = self._followed, thrust_n
        applied.roll_rad, applied.pitch_rad, applied.yaw_rad = self._angles_rad
        self._setpoints.tell(applied, self._no_seat)
        report = loop.outputs["attitude_report"].value
        report.torque_b_nm, report.previous_torque_b_nm = torque_nm, self._torque_nm
        report.torque_min_b_nm = tuple(-limit for limit in bound_nm)
        report.torque_max_b_nm, report.torque_increment_max_b_nm = bound_nm, UNLIMITED
        report.thrust_n = thrust_n


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


def main(name, law, gains):
    """Flies `law(vehicle, period_s, gains)` in the attitude slot; `--config FILE` changes gains."""

    def begin(host):
        own = process.configured(host.options.config, gains)
        vehicle = Vehicle(host.flight["vehicle"])
        period_s = 1.0 / host.graph.rates["attitude"].hz
        made = law(vehicle, period_s, own)
        return Attitude(made, vehicle, host.flight, host.samples), (INPUTS, OUTPUTS)

    sys.exit(process.main(name, "an attitude controller of a morphquad run", "attitude", begin))


def fly(torque):
    """Flies a law without gains or memory of its own, `torque(sample)` [N m], in the attitude slot."""
    main(process.own_name(), lambda _vehicle, _period_s, _gains: Law(torque), {})


class Law(typing.NamedTuple):
    """A law that is one function."""

    torque: typing.Callable
