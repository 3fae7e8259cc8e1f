"""A flight, flown by the executable."""

import dataclasses
import os
from collections.abc import Iterable, Mapping
from typing import Any

from . import executable
from .recording import Recording, open as open_recording

# Exit codes of a flight that has a summary: passed, a bound violated or the vehicle lost, a swap of the script refused or
# taken back.
FLOWN = (0, 1, 5)


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What a flight is worth, by the limits of its scenario."""

    passed: bool
    # PASSED or what was wrong, and why, in one line.
    line: str
    # Each judgement: `key`, `grade`, `measured` and `limit` in the unit that ends the key, and `text`.
    reasons: list[dict[str, Any]]

    def __bool__(self) -> bool:
        return self.passed


@dataclasses.dataclass(frozen=True)
class Flight:
    """A flight that was flown to its end."""

    verdict: Verdict
    # Everything that `morphquad run --format json` tells.
    summary: dict[str, Any]
    # None for a flight that recorded nothing.
    recording: Recording | None
    exit_code: int


def run(
    scenario: str | os.PathLike[str] = "figure8-morph",
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    clock: str | None = None,
    set: Mapping[str, Any] | None = None,
    crew: Mapping[str, str] | None = None,
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

    `set` changes keys of the scenario, for example `{"start.morph_angle_deg": 120}`; `crew` fills slots, for example
    `{"attitude": "attitude-lqr"}`; `swap`, `standby`, `fault`, `goto` and `morph` take what the flags of `morphquad run`
    take, such as `"attitude=attitude-pid@6s"`. The recording goes into the folder `record`, or nowhere if that is None.

    Raises `MorphquadError` if nothing could be flown, or a process crashed.
    """
    words = ["run", os.fspath(scenario)]
    for flag, value in (("--seed", seed), ("--clock", clock), ("--name", name)):
        if value is not None:
            words += [flag, str(value)]
    if duration_s is not None:
        words += ["--for", f"{round(duration_s * 1e9)}ns"]
    words += ["--record", os.fspath(record)] if record is not None else ["--no-record"]
    words += ["--in-process"] if in_process else []
    for key, value in (set or {}).items():
        words += ["--set", f"{key}={_toml(value)}"]
    for slot, controller in (crew or {}).items():
        words += ["--crew", f"{slot}={controller}"]
    lists = {"swap": swap, "standby": standby, "fault": fault, "goto": goto, "morph": morph}
    for flag, values in lists.items():
        for value in [values] if isinstance(values, str) else values:
            words += [f"--{flag}", value]
    summary, exit_code = executable.ask(*words, passes=FLOWN)
    verdict = Verdict(exit_code == 0, summary["line"], summary["verdict"]["reasons"])
    recorded = summary.get("recording")
    return Flight(verdict, summary, open_recording(recorded) if recorded else None, exit_code)


def _toml(value: Any) -> str:
    """A value as a scenario has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(each) for each in value) + "]"
    return str(value)
