"""The installed package: flights, recordings as tables, and a controller of ten lines."""

import json
import math
import os
import pathlib
import tempfile
import unittest
import unittest.mock

import matplotlib
import morphquad
from morphquad.controller import within
from morphquad.units import unit_of

NOTEBOOK = pathlib.Path(__file__).absolute().parent.parent / "flight.ipynb"
# The controller of ten lines that the readme shows.
README = NOTEBOOK.with_name("README.md").read_text()
TEN_LINES = "#!/usr/bin/env python3" + README.split("#!/usr/bin/env python3", 1)[1].split("```", 1)[0]
POSITION = """#!/usr/bin/env python3
import morphquad


def acceleration(sample):
    gains = zip(sample.target_m, sample.position_m, sample.target_m_s, sample.velocity_m_s)
    return [20.0 * (to - at) + 9.0 * (to_s - at_s) for to, at, to_s, at_s in gains]


morphquad.fly_position(acceleration)
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
        with self.assertRaises(morphquad.MorphquadError):
            flight.recording["trip"]
        polars = morphquad.open("latest").polars("truth")
        self.assertEqual(polars["position_w_m[2]"].to_list(), truth["position_w_m[2]"].to_list())
        self.assertEqual(morphquad.open("mi").line, flight.verdict.line)

    def test_a_flight_that_misses_its_limits_has_not_passed_and_says_why(self):
        limits = {"verdict.tracking_max_m": 0.0001}
        flight = morphquad.run("hover", duration_s=0.5, set=limits, in_process=True, record=None)
        self.assertFalse(flight.verdict)
        self.assertEqual(flight.exit_code, 1)
        self.assertIn("tracking_max_m", [reason["key"] for reason in flight.verdict.reasons])
        with self.assertRaises(ValueError):
            flight.recording  # noqa: B018

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

    def test_a_flight_that_crashed_says_so_in_one_line_and_keeps_its_summary(self):
        with self.assertRaises(morphquad.MorphquadError) as raised:
            morphquad.run("hover", duration_s=1.0, fault="kill:plant@500ms", set=PATIENCE, record=None)
        error = raised.exception
        self.assertEqual((error.exit_code, error.answer["line"]), (4, str(error)))
        self.assertRegex(str(error), r"^CRASHED .*plant killed by signal 9")

    def test_arguments_that_no_flight_could_have_are_refused_before_it(self):
        with self.assertRaisesRegex(TypeError, "number of seconds"):
            morphquad.run("hover", duration_s="3")
        with self.assertRaisesRegex(ValueError, "standard input"):
            morphquad.run("-")

    def test_a_torque_is_cut_to_its_bounds_and_nothing_else_is_made_of_it(self):
        bound_nm = (0.2, 0.3, 0.1)
        self.assertEqual(within((0.1, -0.9, 0.5), bound_nm), [0.1, -0.3, 0.1])
        self.assertTrue(math.isnan(within((math.nan, 0.0, 0.0), bound_nm)[0]), "for the host to refuse")
        self.assertEqual(within((0.1,), bound_nm), (0.1,))

    def swapped(self, slot, text):
        """A flight in which the controller of a text takes a slot, or is refused."""
        controller = pathlib.Path("mine.py").absolute()
        controller.write_text(text)
        controller.chmod(0o755)
        swap = f"{slot}={controller}@500ms,shadow=600ms,rollback=500ms"
        return morphquad.run("hover", duration_s=3.0, swap=swap, set=PATIENCE, record=None)

    def test_a_controller_of_ten_lines_takes_the_attitude_slot(self):
        flight = self.swapped("attitude", TEN_LINES)
        self.assertEqual(flight.exit_code, 0, flight.summary["swaps"])
        self.assertTrue(flight.summary["swaps"][0]["done"], flight.summary["swaps"])

    def test_a_controller_that_is_refused_leaves_a_flight_that_passed_and_says_so(self):
        with self.assertWarnsRegex(UserWarning, "mine.py does not fly the attitude slot: .*torque"):
            flight = self.swapped("attitude", TEN_LINES.replace("return [", "return [0.0] or ["))
        self.assertEqual((flight.exit_code, bool(flight.verdict)), (5, True), flight.summary["swaps"])
        summary = json.dumps(flight.summary)
        self.assertIn("torque(sample) gave 1 numbers, and three are needed", summary)

    def test_a_controller_finds_the_python_that_flies_it_wherever_the_path_leads(self):
        path = os.pathsep.join(part for part in os.environ["PATH"].split(os.pathsep) if "python" not in part)
        with unittest.mock.patch.dict(os.environ, {"PATH": path}):
            flight = self.swapped("attitude", TEN_LINES)
        self.assertEqual(flight.exit_code, 0, flight.summary["swaps"])

    def test_a_position_law_of_one_function_takes_its_slot(self):
        flight = self.swapped("position", POSITION)
        self.assertEqual(flight.exit_code, 0, flight.summary["swaps"])

    def test_settings_are_written_as_a_scenario_has_them(self):
        wind = {"kind": "wind", "mean_w_m_s": [1, 0.5, 0.0]}
        settings = {"scenario.name": "true", "disturbance_injector.script": [wind]}
        flight = morphquad.run("hover", duration_s=0.3, set=settings, in_process=True)
        self.assertEqual(flight.summary["scenario"], "true")
        for wrong in ({"seed": object()}, ["a=1"]):
            with self.assertRaises(TypeError):
                morphquad.run("hover", set=wrong)


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
            ("points[0].position_w_m[0]", "m"),
            ("gain_per_s", None),
            ("q_wb.w", None),
            ("sequence", None),
        ):
            self.assertEqual(unit_of(column), unit, column)


if __name__ == "__main__":
    unittest.main()
