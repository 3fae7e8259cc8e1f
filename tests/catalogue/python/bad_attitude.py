#!/usr/bin/env python3
"""A bad attitude controller: the law of attitude_pd.py, spoiled as `--config FILE` says."""

from faults import FAULT, Spoiler

from attitude_pd import GAINS, AttitudePd
from host import attitude


class Bad(AttitudePd):
    """The good law; what it commands is spoiled, and its integral does not know."""

    def __init__(self, vehicle, period_s, gains):
        super().__init__(vehicle, period_s, gains)
        self._spoiler = Spoiler(period_s, gains)

    def torque(self, sample):
        """Spoiled torque [N m]."""
        return self._spoiler.spoil(super().torque(sample))


if __name__ == "__main__":
    attitude.main("bad_attitude", Bad, GAINS | FAULT)
