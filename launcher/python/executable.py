"""Puts the executable `morphquad` into the wheel, stripped, and names the oldest glibc that can run both."""

import os
import pathlib
import platform
import re
import subprocess
import tempfile

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Executable(BuildHookInterface):
    """What cargo has built for release, or the file that MORPHQUAD_EXECUTABLE names."""

    PLUGIN_NAME = "custom"

    def initialize(self, version, build_data):
        root = pathlib.Path(self.root).parent.parent
        target = os.environ.get("CARGO_TARGET_DIR", root / "target")
        built = pathlib.Path(os.environ.get("MORPHQUAD_EXECUTABLE") or pathlib.Path(target, "release", "morphquad"))
        if not built.is_file():
            raise SystemExit(f"{built} is not there: run `cargo build --release` before the wheel is built")
        self._folder = tempfile.TemporaryDirectory()
        stripped = pathlib.Path(self._folder.name, "morphquad")
        subprocess.run(["strip", "--strip-all", "-o", stripped, built], check=True)
        build_data["shared_scripts"][str(stripped)] = "morphquad"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{oldest_platform(stripped.read_bytes())}"

    def finalize(self, version, build_data, artifact_path):
        self._folder.cleanup()


def oldest_platform(executable):
    """Platform tag of the oldest glibc that has every version of a symbol that the executable asks for (PEP 600)."""
    minors = [int(minor) for minor in re.findall(rb"GLIBC_2\.(\d+)", executable)]
    if not minors:
        raise SystemExit("the executable asks for no version of glibc: the wheel is of Linux with glibc alone")
    return f"manylinux_2_{max(minors)}_{platform.machine()}"
