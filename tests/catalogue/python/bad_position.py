#!/usr/bin/env python3
"""A bad position controller: the law of position_pd.py with the fault that `--config FILE` defines."""

from faults import FAULT, Spoiler

from position_pd import GAINS, PositionPd
from host import position


class Bad(PositionPd):
    """The good law; the fault is applied to its output, so that its integral does not see it."""

    def __init__(self, vehicle, period_s, gains):
        super().__init__(vehicle, period_s, gains)
        self._spoiler = Spoiler(period_s, gains)

    def acceleration(self, sample):
        """Acceleration in the world frame with the fault [m/s^2]."""
        return self._spoiler.spoil(super().acceleration(sample))


if __name__ == "__main__":
    position.main("bad_position", Bad, GAINS | FAULT)
