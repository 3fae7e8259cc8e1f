"""The faults of the bad controllers in Python, and the import path of the good ones that they build on."""

import math
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "services" / "attitude-python"))

# Keys and defaults of a configuration file, as in the catalogue in Rust. Axis 0 is thrust there, so that axis 1 is
# the first component of a vector here.
FAULT = {"fault": "nothing", "axis": 0, "amount": 0.0, "after_s": 0.0}


class Spoiler:
    """Applies a fault to the vector that a law commands."""

    def __init__(self, period_s, options):
        self._fault, self._axis = options["fault"], options["axis"]
        self._amount, self._after_s, self._period_s = options["amount"], options["after_s"], period_s
        self._first, self._steps = None, 0

    def spoil(self, command):
        """The command of a step, with the fault."""
        flown_s = self._steps * self._period_s
        self._steps += 1
        if flown_s < self._after_s:
            return list(command)
        self._first = self._first or list(command)
        if self._fault == "wrong-sign":
            return [-x if axis == self._axis else x for axis, x in enumerate(command, start=1)]
        if self._fault == "gain":
            return [self._amount * value for value in command]
        if self._fault == "frozen":
            return list(self._first)
        if self._fault == "not-a-number":
            return [math.nan] * 3
        return list(command)
