#!/usr/bin/env python3
"""An attitude controller in Python: takes the attitude slot of a realtime run.

    morphquad swap attitude --to services/attitude-python/attitude_pd.py

Angle error to body rate, rate error to torque (PD), and an integral that holds what is constantly
missing and makes the change of hands smooth.
"""

import math
import os
import pathlib
import sys
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
try:
    import iceoryx2  # noqa: F401
except ImportError:
    # Whoever starts this file by its path need not have activated its environment.
    python = HERE / ".venv/bin/python"
    if not python.exists() or pathlib.Path(sys.prefix) == HERE / ".venv":
        sys.exit("attitude_pd.py: iceoryx2 is missing; see services/attitude-python/README.md")
    os.execv(python, [str(python), *sys.argv])

import run  # noqa: E402

NAME = "attitude_pd"
# An estimate older than this, and than two periods, is not flown on [ns].
STALE_NS = 20_000_000
GAINS = {
    "angle_per_s": [14.0, 14.0, 14.0],  # Body rate per angle error [1/s].
    "rate_per_s": [45.0, 45.0, 55.0],  # Angular acceleration per rate error [1/s].
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


class Vehicle:
    """What of the modelled vehicle an attitude controller needs."""

    def __init__(self, vehicle):
        self._vehicle = vehicle
        self.weight_n = vehicle["mass_kg"] * vehicle["gravity_m_s2"]
        self.thrust_max_n = 4.0 * vehicle["rotor_thrust_max_n"]

    def _at(self, law, morph_angle_rad):
        c0, c1, c2 = self._vehicle[law]
        degrees = min(max(math.degrees(morph_angle_rad), 45.0), 160.0)
        return c0 + degrees * (c1 + degrees * c2)

    def inertia(self, morph_angle_rad):
        """Principal inertia [kg m^2]."""
        laws = ("inertia_xx_kg_m2", "inertia_yy_kg_m2", "inertia_zz_kg_m2")
        scale = self._vehicle["inertia_scale"]
        return [scale * self._at(law, morph_angle_rad) for law in laws]

    def bound(self, morph_angle_rad, thrust_n):
        """Largest torque that the rotors can give at this thrust [N m]."""
        arm_m = self._at("arm_length_m", morph_angle_rad)
        tilt_nm = arm_m * min(0.5 * self.weight_n, 0.5 * thrust_n)
        return [tilt_nm, tilt_nm, self._vehicle["yaw_coefficient_m"] * self.weight_n]


class SetPoint:
    """What the position slot asks for: its owner, or its fallback if the owner falls silent."""

    def __init__(self, process):
        self._setpoints = process.reader("attitude_setpoint")
        self._owners = process.reader("position_owner", 16)
        self._announced = []
        self._newest = {}
        self.record = None
        self.refused_epoch = 0
        self.seat = process.samples.NO_SEAT
        self.failed_over = False
        self.value = None

    def update(self, t_ns, previous_ns):
        """Takes in what is in effect at t_ns."""
        for record in self._owners.receive():
            if previous_ns is not None and record.header.valid_ns <= previous_ns:
                # That instant is past: whoever wrote the record tries again.
                self.refused_epoch = record.epoch
            else:
                self._announced.append(record)
        while self._announced and self._announced[0].header.valid_ns <= t_ns:
            self.record = self._announced.pop(0)
            self.seat, self.failed_over = self.record.owner, False
        for sample in self._setpoints.receive():
            values = (sample.thrust_n, sample.roll_rad, sample.pitch_rad, sample.yaw_rad)
            if all(map(math.isfinite, values)):
                self._newest.setdefault(sample.header.seat, []).append(sample)
        if self.record is None:
            return
        if not self._is_valid(self.seat, t_ns) and self._is_valid(self.record.fallback, t_ns):
            # Latched until the next epoch.
            self.seat, self.failed_over = self.record.fallback, True
        for sample in self._in_effect(self.seat, t_ns):
            self.value = sample

    def _in_effect(self, seat, t_ns):
        """The newest sample of a seat in effect, if any; those before it are forgotten."""
        samples = self._newest.get(seat, [])
        while len(samples) > 1 and samples[1].header.valid_ns <= t_ns:
            samples.pop(0)
        return samples[:1] if samples and samples[0].header.valid_ns <= t_ns else []

    def _is_valid(self, seat, t_ns):
        in_effect = self._in_effect(seat, t_ns)
        if not in_effect:
            return False
        return t_ns <= in_effect[0].header.valid_ns + 2 * self.record.period_ns[seat]


class Controller:
    """The attitude loop."""

    def __init__(self, process):
        self.process = process
        self.gains = dict(GAINS)
        if process.options.config:
            self.gains.update(tomllib.loads(process.options.config.read_text()))
        self.vehicle = Vehicle(process.flight["vehicle"])
        self.estimates = process.reader("state_estimate")
        self.applied_commands = process.reader("applied_command")
        self.estimator_marks = process.marks_of("estimator")
        self.setpoint = SetPoint(process)
        self.writers = {
            topic: [process.writer(topic), 0, self.latency_ns(topic)]
            for topic in ("wrench_command", "applied_setpoint", "attitude_report")
        }
        self.estimate = self.applied = self.previous_ns = None
        self.received_mono_ns = 0
        self.estimator_mark_ns = 0
        self.integral = [0.0, 0.0, 0.0]
        self.torque = [0.0, 0.0, 0.0]

    def latency_ns(self, topic):
        edges = [edge for edge in self.process.flight["edges"] if edge["topic"] == topic]
        return edges[0]["latency_ns"] if edges else 0

    def is_final(self, t_ns):
        """True once the estimator has published all until t_ns."""
        for mark in self.estimator_marks.receive():
            self.estimator_mark_ns = max(self.estimator_mark_ns, mark.mark_ns)
        return self.estimator_mark_ns > t_ns

    def step(self, t_ns):
        """Publishes torque and thrust for t_ns."""
        start_mono_ns = run.now_ns()
        for estimate in self.estimates.receive():
            if estimate.header.valid_ns <= t_ns:
                self.estimate, self.received_mono_ns = estimate, start_mono_ns
        for applied in self.applied_commands.receive():
            if applied.header.valid_ns <= t_ns and applied.command_sequence > 0:
                self.applied = applied
        self.setpoint.update(t_ns, self.previous_ns)
        self.previous_ns = t_ns
        estimate = self.estimate
        stale_ns = max(2 * self.process.period_ns, STALE_NS)
        if estimate is None or t_ns > estimate.header.valid_ns + stale_ns:
            return  # The command lapses, and the plant's gate holds and levels by itself.
        wanted = self.setpoint.value
        thrust_n, angles = self.vehicle.weight_n, (0.0, 0.0, self.process.flight["start_yaw_rad"])
        if wanted is not None:
            thrust_n = min(max(wanted.thrust_n, 0.0), self.vehicle.thrust_max_n)
            angles = (wanted.roll_rad, wanted.pitch_rad, wanted.yaw_rad)
        bound = self.vehicle.bound(estimate.morph_angle_rad, thrust_n)
        previous = self.torque
        self.torque = self.law(t_ns, estimate, angles, bound)
        self.publish(start_mono_ns, thrust_n, angles, bound, previous)

    def law(self, t_ns, estimate, angles, bound):
        """Torque [N m] for an attitude [rad], within the bound."""
        q = estimate.q_wb
        error = rotation_between((q.w, q.x, q.y, q.z), quaternion_of(*angles))
        inertia = self.vehicle.inertia(estimate.morph_angle_rad)
        share = self.process.period_ns * 1e-9 / self.gains["integral_s"]
        torque = []
        for axis in range(3):
            wanted_rate = self.gains["angle_per_s"][axis] * error[axis]
            rate_error = wanted_rate - estimate.body_rate_b_rad_s[axis]
            law = inertia[axis] * self.gains["rate_per_s"][axis] * rate_error
            if t_ns < self.process.track_until_ns and self.applied is not None:
                # A shadow's next command continues from what the rotors were told.
                self.integral[axis] = self.applied.torque_b_nm[axis] - law
            wish = law + self.integral[axis]
            given = min(max(wish, -bound[axis]), bound[axis])
            if (given - wish) * law >= 0.0:  # Beyond a bound it only comes back.
                self.integral[axis] += share * law
            torque.append(given)
        return torque

    def publish(self, start_mono_ns, thrust_n, angles, bound, previous):
        samples, setpoint = self.process.samples, self.setpoint
        wrench = samples.WrenchCommand(
            thrust_n=thrust_n,
            torque_b_nm=tuple(self.torque),
            validity_ns=2 * self.process.period_ns,
        )
        applied = samples.AppliedSetpoint(
            setpoint_sequence=setpoint.value.header.sequence if setpoint.value else 0,
            epoch=setpoint.record.epoch if setpoint.record else 0,
            refused_epoch=setpoint.refused_epoch,
            thrust_n=thrust_n,
            roll_rad=angles[0],
            pitch_rad=angles[1],
            yaw_rad=angles[2],
            seat=setpoint.seat,
            failed_over=setpoint.failed_over,
        )
        report = samples.AttitudeReport(
            torque_b_nm=tuple(self.torque),
            previous_torque_b_nm=tuple(previous),
            torque_min_b_nm=tuple(-limit for limit in bound),
            torque_max_b_nm=tuple(bound),
            torque_increment_max_b_nm=(math.inf, math.inf, math.inf),
            thrust_n=thrust_n,
        )
        received = self.received_mono_ns
        header = self.process.header(self.estimate.header, received, start_mono_ns)
        values = (wrench, applied, report)
        for value, (topic, (writer, sequence, latency_ns)) in zip(values, self.writers.items()):
            value.header = header
            value.header.sequence = sequence + 1
            value.header.valid_ns = header.release_ns + latency_ns
            writer.send(value)
            self.writers[topic][1] += 1


def fly(process):
    if process.options.slot != "attitude":
        raise run.Unfit("it flies the attitude slot: --slot attitude")
    controller = Controller(process)
    process.take_seat()
    return process.fly(controller.is_final, controller.step)


if __name__ == "__main__":
    sys.exit(run.main(NAME, __doc__.splitlines()[0], fly))
