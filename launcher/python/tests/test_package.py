"""The installed package: flights, recordings as tables, and a controller of ten lines."""

import json
import math
import os
import pathlib
import tempfile
import unittest

import matplotlib
import morphquad
from morphquad.units import unit_of

NOTEBOOK = pathlib.Path(__file__).absolute().parent.parent / "flight.ipynb"
TEN_LINES = """#!/usr/bin/env python3
import morphquad


def torque(sample):
    rate_rad_s = sample.estimate.body_rate_b_rad_s
    law = zip(sample.inertia_kg_m2, sample.error_rad, rate_rad_s)
    return [50.0 * inertia * (16.0 * error - rate) for inertia, error, rate in law]


morphquad.fly_attitude(torque)
"""
# A busy machine may take its time.
PATIENCE = {
    "launcher.startup_timeout_s": 600,
    "launcher.stall_timeout_s": 600,
    "rehearsal.wall_max_s": 600,
}


class Folder(unittest.TestCase):
    """Each test has an empty folder to itself."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(folder.name)


class Package(Folder):
    def test_a_flight_has_a_verdict_and_a_recording_whose_tables_have_units(self):
        flight = morphquad.run("hover", seed=3, duration_s=0.5, in_process=True, name="mine")
        self.assertTrue(flight.verdict and flight.verdict.line.startswith("PASSED"), flight.verdict)
        self.assertEqual(flight.summary["seed"], 3)
        self.assertEqual(flight.recording.facts["scenario"], "hover")
        truth = flight.recording["truth"]
        self.assertEqual(truth.index.name, "t_s")
        self.assertEqual(len(truth), 500)
        self.assertEqual(truth.attrs["units"]["velocity_w_m_s[0]"], "m/s")
        self.assertLess(abs(truth["position_w_m[2]"].iloc[-1] - 1.5), 0.05)
        self.assertIn("imu", flight.recording.topics)
        polars = morphquad.open("latest").polars("truth")
        self.assertEqual(polars["position_w_m[2]"].to_list(), truth["position_w_m[2]"].to_list())
        self.assertEqual(morphquad.open("mi").line, flight.verdict.line)

    def test_a_flight_that_misses_its_limits_has_not_passed_and_says_why(self):
        limits = {"verdict.tracking_max_m": 0.0001}
        flight = morphquad.run("hover", duration_s=0.5, set=limits, in_process=True, record=None)
        self.assertFalse(flight.verdict)
        self.assertEqual(flight.exit_code, 1)
        self.assertIn("tracking_max_m", [reason["key"] for reason in flight.verdict.reasons])
        self.assertIsNone(flight.recording)

    def test_what_cannot_be_done_is_said_in_the_words_of_the_executable(self):
        for wrong in (
            lambda: morphquad.run("nowhere"),
            lambda: morphquad.run("hover", set={"plant.rate_hz": math.nan}),
            lambda: morphquad.open("nowhere.mcap"),
        ):
            with self.assertRaises(morphquad.MorphquadError) as raised:
                wrong()
            self.assertEqual(raised.exception.exit_code, 2)
            self.assertGreater(len(str(raised.exception)), 20)

    def test_a_controller_of_ten_lines_takes_the_attitude_slot(self):
        controller = pathlib.Path("mine.py").absolute()
        controller.write_text(TEN_LINES)
        controller.chmod(0o755)
        swap = f"attitude={controller}@500ms,shadow=600ms,rollback=500ms"
        flight = morphquad.run("hover", duration_s=3.0, swap=swap, set=PATIENCE, record=None)
        self.assertEqual(flight.exit_code, 0, flight.summary["swaps"])
        self.assertTrue(flight.summary["swaps"][0]["done"], flight.summary["swaps"])


class Notebook(Folder):
    def test_every_cell_of_the_notebook_runs(self):
        matplotlib.use("Agg")
        cells = json.loads(NOTEBOOK.read_text())["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        self.assertGreater(len(code), 3)
        names = {}
        for source in code:
            exec(compile(source, str(NOTEBOOK), "exec"), names)
        self.assertEqual(names["swapped"].exit_code, 0)


class Units(unittest.TestCase):
    def test_a_name_ends_with_its_unit(self):
        for column, unit in (
            ("position_w_m[2]", "m"),
            ("body_rate_b_rad_s[0]", "rad/s"),
            ("header.valid_ns", "ns"),
            ("torque_b_nm[1]", "N m"),
            ("inertia_kg_m2[0]", "kg m²"),
            ("thrust_n", "N"),
            ("q_wb.w", None),
            ("sequence", None),
        ):
            self.assertEqual(unit_of(column), unit, column)


if __name__ == "__main__":
    unittest.main()
