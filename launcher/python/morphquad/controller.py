"""Controllers that take a slot of a flight: one function each.

The package `morphquad.host` has what these are made of, and takes laws with gains and a memory:
`host.attitude.main` and `host.position.main`.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .host import attitude, position


def fly_attitude(torque: "Callable[[attitude.Sample], Sequence[float]]") -> None:
    """Flies `torque(sample)` in the attitude slot; ends with the process.

    The law returns three numbers: the torque about the x, y and z axis of the body (forward, left, up) [N m]. What is
    beyond the bound of its axis is cut to it, as rotors cannot give more; three other things than finite numbers end
    the controller with an error.

    The sample has `t_ns`; the state `estimate` with `q_wb`, `body_rate_b_rad_s` and all that the estimator
    publishes; the rotation `error_rad` in the body frame to the attitude to take; `attitude_rad` (roll, pitch,
    yaw) and `thrust_n` as asked for; `inertia_kg_m2` and `bound_nm`, the largest torque, about each axis; and
    `tracked_nm`, from which the next torque is to continue while the controller still shadows another, else None.
    """
    from .host import attitude

    attitude.fly(lambda sample: within(torque(sample), sample.bound_nm))


def within(torque_nm: Sequence[float], bound_nm: Sequence[float]) -> Sequence[float]:
    """A torque cut to its bounds [N m]; anything else than three numbers as it is, for the host to refuse."""
    if len(torque_nm) != len(bound_nm):
        return torque_nm
    return [min(max(asked, -bound), bound) for asked, bound in zip(torque_nm, bound_nm)]


def fly_position(acceleration: "Callable[[position.Sample], Sequence[float]]") -> None:
    """Flies `acceleration(sample)` in the position slot; ends with the process.

    The law returns three numbers: the acceleration east, north and up [m/s²] beside that which balances the weight. What
    the bounds on tilt and thrust do not allow is cut.

    The sample has `t_ns`; `position_m` and `velocity_m_s` as estimated; `target_m`, `target_m_s` and
    `target_m_s2`, where to be and how to move; and `tracked_m_s2`, from which the next acceleration is to continue
    while the controller still shadows another, else None.
    """
    from .host import position

    position.fly(acceleration)
