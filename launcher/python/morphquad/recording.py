"""Recordings as tables."""

import functools
import os
import pathlib
import shutil
import tempfile
import weakref
from typing import TYPE_CHECKING, Any

from . import executable
from .units import unit_of

if TYPE_CHECKING:
    import pandas
    import polars


class Recording:
    """A recording. `recording["truth"]` is a topic as a pandas DataFrame: a row for each sample, the index `t_s` the
    instant from which it is in effect [s], a column for each number, `field[2]` for an element of a list.

    Made of a file; `open` also takes a name, or "latest".
    """

    def __init__(self, file: str | os.PathLike[str]) -> None:
        self.file = os.path.abspath(file)
        self._tables = pathlib.Path(tempfile.mkdtemp(prefix="morphquad-"))
        weakref.finalize(self, shutil.rmtree, self._tables, ignore_errors=True)

    def __repr__(self) -> str:
        return f"<Recording {self.file}>"

    @functools.cached_property
    def _shown(self) -> dict[str, Any]:
        shown, _ = executable.ask("recordings", "show", self.file)
        return shown

    @property
    def line(self) -> str:
        """The verdict of its flight in one line."""
        return self._shown["line"]

    @property
    def facts(self) -> dict[str, str]:
        """Run, build and machine."""
        return self._shown["facts"]

    @property
    def topics(self) -> list[str]:
        """Names of the topics that have samples in it."""
        info, _ = executable.ask("topic", "info", self.file)
        return sorted(topic for topic, seats in info["topics"].items() if any(seat["count"] for seat in seats))

    def report(self) -> dict[str, Any]:
        """Everything that `morphquad report --format json` prints: verdict, numbers with their limits, swaps."""
        report, _ = executable.ask("report", self.file, passes=(0, 1))
        return report

    def __getitem__(self, topic: str) -> "pandas.DataFrame":
        """A topic with units in `attrs["units"]` by column; needs `pip install 'morphquad[pandas]'`.

        Raises `MorphquadError` for a topic that is not there.
        """
        import pandas

        table = pandas.read_parquet(self.parquet(topic)).set_index("t_s")
        table.attrs["units"] = {column: unit_of(column) for column in table.columns}
        return table

    def polars(self, topic: str) -> "polars.DataFrame":
        """A topic with `t_s` as its first column; needs `pip install 'morphquad[polars]'`.

        Raises `MorphquadError` for a topic that is not there.
        """
        import polars

        return polars.read_parquet(self.parquet(topic))

    def parquet(self, topic: str) -> pathlib.Path:
        """A topic as a Parquet file, which lasts as long as this object."""
        path = self._tables / f"{topic.strip('/')}.parquet"
        if not path.exists():
            executable.ask("topic", "export", self.file, topic, "--parquet", "--out", str(self._tables))
        if not path.exists():
            raise executable.MorphquadError(f"{self.file} has no sample of {topic}", 2)
        return path


def open(file: str | os.PathLike[str] = "latest") -> Recording:  # noqa: A001
    """Opens a recording: a file, the beginning of a name in `recordings/`, or the latest there.

    Raises `MorphquadError` for a file that cannot be read.
    """
    shown, _ = executable.ask("recordings", "show", os.fspath(file))
    recording = Recording(shown["file"])
    recording._shown = shown
    return recording
