"""Fly a morphing quadrotor, read what was recorded, and write controllers that take its slots.

    import morphquad

    flight = morphquad.run("figure8-morph", seed=3)
    print(flight.verdict.line)
    truth = flight.recording["truth"]  # A pandas DataFrame, units in `truth.attrs["units"]`.

A file with a law and one call is a controller that `morphquad swap attitude --to FILE` brings into a flight:

    #!/usr/bin/env python3
    import morphquad

    def torque(sample):
        rate_rad_s = sample.estimate.body_rate_b_rad_s
        law = zip(sample.inertia_kg_m2, sample.error_rad, rate_rad_s)
        return [50.0 * inertia * (16.0 * error - rate) for inertia, error, rate in law]

    morphquad.fly_attitude(torque)
"""

from .controller import fly_attitude, fly_position
from .executable import MorphquadError
from .flight import Flight, Verdict, run
from .recording import Recording
# As a re-export in the sense of type checkers, which `__all__` would be too.
from .recording import open as open

# `open` is left out, so that `from morphquad import *` hides no built-in.
__all__ = [
    "Flight",
    "MorphquadError",
    "Recording",
    "Verdict",
    "fly_attitude",
    "fly_position",
    "run",
]
