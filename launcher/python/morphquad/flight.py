"""A flight, flown by the executable."""

import dataclasses
import functools
import json
import math
import os
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

from . import executable
from .recording import Recording

# Exit codes of a flight that has a summary: passed, a bound violated or the vehicle lost, a swap of the script
# refused or taken back.
FLOWN = (0, 1, 5)
# Those of them with which the flight itself has passed.
PASSED = (0, 5)
# How a swap of the script ended that spoils the exit code.
SPOILED = ("refused", "taken-back")


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What a flight is worth, by the limits of its scenario. A swap that was refused or taken back is no part of
    it: see `Flight.exit_code` and `Flight.summary["swaps"]`.

    `line` is PASSED or what was wrong, and why, in one line; `reasons` are the judgements, each with `key`, `grade`,
    `measured` and `limit` in the unit that ends the key, and `text`.
    """

    passed: bool
    line: str
    reasons: list[dict[str, Any]] = dataclasses.field(repr=False)

    def __bool__(self) -> bool:
        return self.passed


@dataclasses.dataclass(frozen=True)
class Flight:
    """A flight that was flown to its end.

    `summary` is everything that `morphquad run --format json` prints; `exit_code` is that of the command: 0 passed, 1
    not, 5 passed although a swap of the script was refused or taken back.
    """

    verdict: Verdict
    summary: dict[str, Any] = dataclasses.field(repr=False)
    exit_code: int
    _file: str | None

    @functools.cached_property
    def recording(self) -> Recording:
        """Its recording. Raises `ValueError` for a flight that recorded nothing."""
        if self._file is None:
            raise ValueError("the flight was not recorded: leave `record=None` away")
        return Recording(self._file)


def run(
    scenario: str | os.PathLike[str] = "figure8-morph",
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    clock: str | None = None,
    set: Mapping[str, Any] | None = None,
    controllers: Mapping[str, str] | None = None,
    swap: Iterable[str] = (),
    standby: Iterable[str] = (),
    fault: Iterable[str] = (),
    goto: Iterable[str] = (),
    morph: Iterable[str] = (),
    record: str | os.PathLike[str] | None = "recordings",
    name: str | None = None,
    in_process: bool = False,
) -> Flight:
    """Flies a scenario, shipped or of a file, and waits for its end.

    `set` changes keys of the scenario, for example `{"start.morph_angle_deg": 120}`; `controllers` fills slots, for
    example `{"attitude": "attitude-lqr"}`; `swap`, `standby`, `fault`, `goto` and `morph` take what the flags of
    `morphquad run` take, such as `"attitude=attitude-pid@6s"`. The recording goes into the folder `record`, or
    nowhere if that is None.

    `goto` is in metres and degrees, `morph` in degrees, durations in seconds.

    Warns of each swap of the script that was refused or taken back: the verdict is about the vehicle.

    Raises `MorphquadError` if nothing could be flown, or a process crashed, and `ValueError` or `TypeError` for an
    argument that no flight could have.
    """
    if os.fspath(scenario) == "-":
        raise ValueError("a scenario from standard input is for the command: give a name or a file")
    arguments = ["run", os.fspath(scenario)]
    for flag, value in (("seed", seed), ("clock", clock), ("name", name)):
        if value is not None:
            arguments += [f"--{flag}", str(value)]
    if duration_s is not None:
        if isinstance(duration_s, str):
            raise TypeError(f"duration_s={duration_s!r} is not a number of seconds")
        if not math.isfinite(duration_s) or duration_s < 0.0:
            raise ValueError(f"duration_s={duration_s} is no duration in seconds")
        arguments += ["--for", f"{round(duration_s * 1e9)}ns"]
    arguments += ["--record", os.fspath(record)] if record is not None else ["--no-record"]
    arguments += ["--in-process"] if in_process else []
    for key, value in _mapping("set", set).items():
        arguments += ["--set", f"{key}={_toml(key, value)}"]
    for slot, controller in _mapping("controllers", controllers).items():
        arguments += ["--controller", f"{slot}={controller}"]
    lists = {"swap": swap, "standby": standby, "fault": fault, "goto": goto, "morph": morph}
    for flag, values in lists.items():
        for value in [values] if isinstance(values, str) else values:
            arguments += [f"--{flag}", value]
    summary, exit_code = executable.ask(*arguments, passes=FLOWN)
    verdict = Verdict(exit_code in PASSED, summary["line"], summary["verdict"]["reasons"])
    for swap in summary["swaps"]:
        if swap["scripted"] and swap["ended"] in SPOILED:
            warnings.warn(f"{swap['to']} does not fly the {swap['slot']} slot: {swap['outcome']}", stacklevel=2)
    file = summary.get("recording")
    return Flight(verdict, summary, exit_code, os.path.abspath(file) if file else None)


def _mapping(name: str, value: Mapping[str, Any] | None) -> Mapping[str, Any]:
    if not isinstance(value, Mapping | None):
        raise TypeError(f"{name} is a mapping such as {{...}}, and not {value!r}")
    return value or {}


def _toml(key: str, value: Any) -> str:
    """A value as a scenario has it."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case str():
            return json.dumps(value)
        case Mapping():
            return "{" + ", ".join(f"{name} = {_toml(key, each)}" for name, each in value.items()) + "}"
        case list() | tuple():
            return "[" + ", ".join(_toml(key, each) for each in value) + "]"
    raise TypeError(f"{key}: {value!r} is no value of a scenario")
