#!/usr/bin/env python3
"""A bad attitude controller: the law of attitude_pd.py with the fault that `--config FILE` defines."""

from faults import FAULT, Spoiler

from attitude_pd import GAINS, AttitudePd
from host import attitude


class Bad(AttitudePd):
    """The good law; the fault is applied to its output, so that its integral does not see it."""

    def __init__(self, vehicle, period_s, gains):
        super().__init__(vehicle, period_s, gains)
        self._spoiler = Spoiler(period_s, gains)

    def torque(self, sample):
        """Torque in the body frame with the fault [N m]."""
        return self._spoiler.spoil(super().torque(sample))


if __name__ == "__main__":
    attitude.main("bad_attitude", Bad, GAINS | FAULT)
