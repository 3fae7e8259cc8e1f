#!/usr/bin/env python3
"""A bad position controller: the law of position_pd.py, spoiled as `--config FILE` says."""

from faults import FAULT, Spoiler

from position_pd import GAINS, PositionPd
from host import position


class Bad(PositionPd):
    """The good law; what it asks for is spoiled, and its integral does not know."""

    def __init__(self, vehicle, period_s, gains):
        super().__init__(vehicle, period_s, gains)
        self._spoiler = Spoiler(period_s, gains)

    def acceleration(self, sample):
        """Spoiled acceleration in W [m/s^2]."""
        return self._spoiler.spoil(super().acceleration(sample))


if __name__ == "__main__":
    position.main("bad_position", Bad, GAINS | FAULT)
