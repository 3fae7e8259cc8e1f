"""The executable `morphquad`, which flies and reads recordings."""

import json
import os
import pathlib
import shutil
import subprocess
import sysconfig
from typing import Any


# How long a flight that was interrupted may take to end [s].
LEAVE_S = 15.0


class MorphquadError(Exception):
    """The message of the executable when it could not do what it was asked for.

    `exit_code` is the executable's, and `answer` the JSON that it gave nevertheless, such as the summary of a flight in
    which a process crashed; None if it gave none.
    """

    def __init__(self, message: str, exit_code: int, answer: Any = None) -> None:
        super().__init__(message)
        self.exit_code = exit_code
        self.answer = answer


def path() -> str:
    """The executable: that of MORPHQUAD_EXECUTABLE, the one installed with this package, or the one on the path."""
    installed = pathlib.Path(sysconfig.get_path("scripts"), "morphquad")
    found = os.environ.get("MORPHQUAD_EXECUTABLE") or (str(installed) if installed.is_file() else None)
    found = found or shutil.which("morphquad")
    if found is None:
        raise MorphquadError(f"there is no executable {installed}: install the package morphquad again", 3)
    return found


def ask(*arguments: str, passes: tuple[int, ...] = (0,)) -> tuple[Any, int]:
    """The JSON with which a command answers, and its exit code.

    Raises `MorphquadError` with its message if its exit code is not in `passes`.
    """
    command = [path(), *arguments, "--format", "json"]
    # The first line of a Python controller, `/usr/bin/env python3`, finds the Python that has this package.
    scripts = sysconfig.get_path("scripts")
    environment = os.environ | {"PATH": os.pathsep.join([scripts, os.environ.get("PATH", os.defpath)])}
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, env=environment, **pipes) as process:
        try:
            out, stderr = process.communicate()
        except KeyboardInterrupt:
            # The executable has been interrupted, too, and ends in order.
            try:
                process.communicate(timeout=LEAVE_S)
            except subprocess.TimeoutExpired:
                process.terminate()
            raise
    if process.returncode not in passes:
        answer = _json_of(out)
        line = answer.get("line") if isinstance(answer, dict) else None
        raise MorphquadError(line or stderr.strip() or out.strip(), process.returncode, answer)
    return json.loads(out), process.returncode


def _json_of(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return None
