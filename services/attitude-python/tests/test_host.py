"""The rules by which a Python process waits, takes samples in and follows set points.

    services/attitude-python/.venv/bin/python -m unittest discover services/attitude-python/tests
"""

import ctypes
import math
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import types
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

from host.graph import Edge, Graph, Rate  # noqa: E402
from host.inputs import CAPACITY, Input, Sample, Stamps  # noqa: E402
from host.launcher import Launcher, process_start  # noqa: E402
from host.arbiter import Command, CommandArbiter, Limiter, Record, SetPoints  # noqa: E402
from host.ownership import FOREVER, SeatMarks, SlotBook  # noqa: E402
from host.ports import Bus, Unfit  # noqa: E402
from host.process import configured, leave_s, leave_s_of  # noqa: E402
from host.vehicle import Vehicle  # noqa: E402

MS = 1_000_000
NO_SEAT = 2**32 - 1


def edge(producer, consumer, latency_ms, topic="t", deadline_ms=0):
    strict = consumer == "plant"
    return {
        "topic": topic,
        "from": producer,
        "to": consumer,
        "latency_ns": latency_ms * MS,
        "deadline_ns": deadline_ms * MS,
        "strict": strict,
        "asap": False,
    }


def owner(epoch, valid_ms, owner_seat, fallback=NO_SEAT, periods_ms=(10, 10, 10, 10)):
    header = types.SimpleNamespace(valid_ns=valid_ms * MS)
    periods_ns = [period * MS for period in periods_ms]
    return types.SimpleNamespace(
        header=header, epoch=epoch, owner=owner_seat, fallback=fallback, period_ns=periods_ns
    )


def sample(valid_ms, sequence, seat=0, generation=0):
    return Sample(valid_ms * MS, seat, sequence, generation, 0, b"")


def idler():
    return subprocess.Popen(["sleep", "60"])


def reap(process):
    process.kill()
    process.wait()


def await_that(done):
    """Waits as long as it takes."""
    while not done():
        time.sleep(0.001)


class StampRules(unittest.TestCase):
    def stamped(self, sequence, release_ms, valid_ms, generation=0):
        return sample(valid_ms, sequence, 0, generation)._replace(release_ns=release_ms * MS)

    def test_a_process_whose_sample_is_not_due_a_latency_after_its_release_is_left(self):
        early = self.stamped(2, 20, 15)
        stamps = Stamps(2 * MS, False)
        followed = [stamps.follow(one) for one in (self.stamped(1, 10, 12), early, self.stamped(3, 30, 32))]
        self.assertEqual(followed, [True, False, False])
        self.assertTrue(stamps.follow(self.stamped(1, 25, 27, generation=1)), "it is judged for itself")
        self.assertTrue(Stamps(2 * MS, True).follow(early))

    def test_a_process_that_names_a_step_before_its_last_one_is_left(self):
        stamps = Stamps(0, False)
        released = [(1, 10), (3, 30), (2, 20), (4, 30), (5, 15), (6, 40)]
        followed = [stamps.follow(self.stamped(n, ms, ms)) for n, ms in released]
        self.assertEqual(followed, [True, True, True, True, False, False])
        self.assertTrue(stamps.follow(self.stamped(2, 20, 20)), "what it wrote before may come again")
        last = self.stamped(2**64 - 1, 10, 10)
        self.assertTrue(Stamps(0, False).follow(last), "every number can be followed")


class LauncherRules(unittest.TestCase):
    def test_grace_and_landing_are_times_of_the_flight(self):
        flight = {"clock": "realtime", "grace_s": 3.0, "landing_s": 4.5, "speed": 0.5}
        self.assertEqual(leave_s(flight), 15.0)
        self.assertEqual(leave_s(flight | {"grace_s": 0.0}), 0.0)
        self.assertEqual(leave_s(flight | {"clock": "lockstep"}), 2.0)
        self.assertEqual(leave_s(flight | {"clock": "lockstep", "grace_s": 1.0}), 1.0)

    def test_what_the_launcher_has_noted_last_counts_and_without_it_what_it_noted_first(self):
        flight = {"clock": "realtime", "grace_s": 3.0, "landing_s": 4.5, "speed": 1.0}
        with tempfile.TemporaryDirectory() as folder:
            run = pathlib.Path(folder)
            self.assertEqual(leave_s_of(run, flight), 7.5)
            text = 'clock = "realtime"\ngrace_s = 3.0\nlanding_s = 9.0\nspeed = 1.0\n'
            (run / "flight.toml").write_text(text)
            self.assertEqual(leave_s_of(run, flight), 12.0)
            (run / "flight.toml").write_text('clock = "realtime"\ngrace_s = 3.0\n')
            self.assertEqual(leave_s_of(run, flight), 7.5)

    def test_the_next_launcher_is_followed_and_the_dead_one_is_not_taken_for_it(self):
        first, second = idler(), idler()
        with tempfile.TemporaryDirectory() as folder:
            lock = pathlib.Path(folder) / "launcher.lock"
            lock.write_text(f"{first.pid} {process_start(first.pid)}\n")
            launcher = Launcher(pathlib.Path(folder), first.pid, lambda: 600.0)
            self.assertFalse(launcher.is_gone)
            reap(first)
            await_that(lambda: launcher.is_gone)
            lock.write_text(f"{second.pid} {process_start(second.pid)}\n")
            await_that(lambda: not launcher.is_gone)
            self.assertFalse(launcher.is_given_up)
            reap(second)
            await_that(lambda: launcher.is_gone)

    def test_a_controller_that_hangs_does_not_outlive_its_launcher(self):
        leader = idler()
        hangs = (
            "import pathlib; from host import launcher\n"
            "launcher.LEAVE_LIMIT_S = 0.1\n"
            f"launcher.Launcher(pathlib.Path('/nowhere'), {leader.pid}, lambda: 0.0)\n"
            "print(flush=True)\n"
            "while True: pass"
        )
        folder = pathlib.Path(__file__).resolve().parent.parent
        with subprocess.Popen([sys.executable, "-c", hangs], cwd=folder, stdout=subprocess.PIPE) as process:
            process.stdout.readline()
            reap(leader)
            self.assertEqual(process.wait(), -signal.SIGKILL)


class GraphRules(unittest.TestCase):
    def test_a_rate_that_does_not_divide_a_second_keeps_its_grid_for_an_hour(self):
        rate = Rate(150.0)
        self.assertEqual(rate.instant(1), 6_666_666)
        self.assertEqual(rate.instant(150 * 3600), 3_600_000_000_000)
        for t_ns in (0, 1, 6_666_666, 6_666_667, 10**12 + 7):
            first = rate.first_at_or_after(t_ns)
            self.assertGreaterEqual(rate.instant(first), t_ns)
            self.assertTrue(first == 0 or rate.instant(first - 1) < t_ns)

    def graph(self):
        loops = [
            {"role": "plant", "rate_hz": 1000.0},
            {"role": "estimator", "rate_hz": 1000.0},
            {"role": "position", "rate_hz": 50.0},
            {"role": "attitude", "rate_hz": 100.0},
        ]
        edges = [
            edge("estimator", "attitude", 0, "state_estimate", deadline_ms=1),
            edge("position", "attitude", 1, "attitude_setpoint"),
            edge("attitude", "plant", 1, "wrench_command"),
            edge("attitude", "position", 1, "applied_setpoint"),
            edge("plant", "estimator", 0, "imu"),
        ]
        return Graph({"loops": loops, "edges": edges}, "attitude")

    def marks(self, **roles_ms):
        marks = SeatMarks(4)
        for role, mark_ms in roles_ms.items():
            marks.advance(role, 0, 0, mark_ms * MS)
        return marks

    def test_a_step_waits_for_marks_past_its_instant_less_the_latency(self):
        graph = self.graph()
        for estimator_ms, position_ms, allowed_ms, open_ms in [
            (10, 20, 99, 10),  # The step at 10 ms waits for the estimate of 10 ms.
            (11, 20, 99, 11),
            (30, 20, 99, 21),  # A latency of 1 ms permits one more.
            (30, 40, 25, 25),
        ]:
            marks = self.marks(estimator=estimator_ms, position=position_ms)
            self.assertEqual(graph.open_until_ns(marks, allowed_ms * MS), open_ms * MS)

    def test_only_those_whose_release_may_be_unblocked_are_woken(self):
        graph = self.graph()
        self.assertEqual(graph.wakes(0, 10 * MS), {"plant"})
        self.assertEqual(graph.wakes(10 * MS, 20 * MS), {"plant", "position"})
        self.assertEqual(graph.wakes(20 * MS, 30 * MS), {"plant"})
        self.assertEqual(graph.wakes(20 * MS, FOREVER), {"plant", "position"})

    def test_the_strict_consumer_may_run_up_to_the_mark_itself(self):
        strict = Edge("t", "attitude", "plant", MS, 0, True, False)
        self.assertEqual(strict.open_until_ns(10 * MS), 11 * MS + 1)

    def test_in_realtime_an_input_is_missing_until_it_is_final_and_without_a_deadline_never(self):
        graph = self.graph()
        self.assertEqual(graph.missing_deadline_ns(self.marks(estimator=10), 10 * MS), MS)
        self.assertEqual(graph.missing_deadline_ns(self.marks(estimator=11), 10 * MS), 0)


class OwnershipRules(unittest.TestCase):
    def mark_ms(self, seats_ms, records, latency_ms=1):
        marks = SeatMarks(4)
        for seat, mark_ms in enumerate(seats_ms):
            marks.advance("position", seat, 0, mark_ms * MS)
        for record in records:
            marks.book("position").learn(record)
        return marks.of_edge(Edge("t", "position", "attitude", latency_ms * MS, 0, False, False)) // MS

    def test_the_old_owner_is_waited_for_until_the_change_and_the_new_one_after_it(self):
        records = [owner(1, 0, 0), owner(2, 101, 1)]
        # The change at 101 ms concerns what is released from 100 ms on.
        self.assertEqual(self.mark_ms([90, 120, 0, 0], records), 90)
        self.assertEqual(self.mark_ms([99, 120, 0, 0], records), 99)
        self.assertEqual(self.mark_ms([100, 120, 0, 0], records), 120)
        self.assertEqual(self.mark_ms([100, 80, 0, 0], records), 100)
        self.assertEqual(self.mark_ms([100, 120, 0, 0], records, latency_ms=0), 100)

    def test_a_fallback_is_waited_for_and_a_shadow_is_not(self):
        self.assertEqual(self.mark_ms([90, 10, 10, 10], [owner(1, 0, 0)]), 90)
        self.assertEqual(self.mark_ms([90, 10, 70, 10], [owner(1, 0, 0, fallback=2)]), 70)

    def test_a_process_that_has_left_is_not_waited_for_and_its_successor_begins_anew(self):
        marks = SeatMarks(4)
        of = lambda: marks.of_edge(Edge("t", "plant", "attitude", 0, 0, False, False)) // MS  # noqa: E731
        marks.advance("plant", 0, 0, 90 * MS)
        marks.learn_registry([("plant", 0, 0, True, 1)])
        self.assertEqual(of(), 90)
        marks.learn_registry([("plant", 0, 0, False, 1)])
        self.assertEqual(of(), FOREVER // MS)
        marks.learn_registry([("plant", 0, 0, False, 1), ("plant", 0, 1, True, 1)])
        self.assertEqual(of(), 0)
        marks.advance("plant", 0, 0, 95 * MS)
        self.assertEqual(of(), 0, "its predecessor's last mark comes late")
        marks.advance("plant", 0, 1, 96 * MS)
        self.assertEqual(of(), 96)

    def test_a_seat_counts_for_the_instants_of_its_tenure_and_as_a_fallback(self):
        book = SlotBook()
        self.assertTrue(book.counts(3, 0), "without a record every seat does")
        book.learn(owner(1, 0, 0))
        book.learn(owner(2, 100, 1, fallback=0))
        book.learn(owner(2, 500, 3))  # An old epoch has no effect.
        expected = [(0, 99, True), (1, 99, False), (1, 100, True), (0, 100, True), (2, 100, False)]
        for seat, at_ms, counts in expected:
            self.assertEqual(book.counts(seat, at_ms * MS), counts, (seat, at_ms))
        book.forget_before(100 * MS)
        self.assertEqual(len(book.tenures), 2, "the step at the change itself takes from both")
        book.forget_before(100 * MS + 1)
        self.assertEqual([tenure.owner for tenure in book.tenures], [1])

    def test_a_seat_that_a_record_leaves_out_is_released_from_then_on(self):
        book = SlotBook()
        book.learn(owner(1, 0, 0))
        self.assertEqual(book.released_ns(1), FOREVER)
        book.learn(owner(2, 300, 0, periods_ms=(10, 0, 10, 10)))
        self.assertEqual((book.released_ns(1), book.released_ns(0)), (300 * MS, FOREVER))


class InputRules(unittest.TestCase):
    def input(self, *samples):
        taken = Input(ctypes.c_uint64, list, "position", True)
        for one in samples:
            taken.arrive(one)
        return taken

    def fresh(self, taken, t_ms, previous_ms=None):
        taken.accept(t_ms * MS, None if previous_ms is None else previous_ms * MS)
        return [(one.valid_ns // MS, one.seat, one.sequence) for one in taken.fresh]

    def test_a_step_takes_in_all_that_is_in_effect_and_nothing_later_in_one_order(self):
        early, late = [sample(5, 1), sample(7, 2), sample(7, 9, seat=1)], [sample(8, 3)]
        for arrival in (early + late, late + early[::-1]):
            taken = self.input(*arrival)
            self.assertEqual(self.fresh(taken, 7), [(5, 0, 1), (7, 0, 2), (7, 1, 9)])
            self.assertEqual(taken.latest.seat, 1)
            self.assertEqual(self.fresh(taken, 8), [(8, 0, 3)])
            self.assertEqual(self.fresh(taken, 9), [])

    def test_a_sample_that_comes_again_is_taken_once(self):
        taken = self.input(sample(5, 1), sample(5, 1), sample(6, 2))
        self.assertEqual(self.fresh(taken, 6), [(5, 0, 1), (6, 0, 2)])
        taken.arrive(sample(6, 2))
        self.assertEqual(self.fresh(taken, 7), [])

    def test_a_loop_that_joins_knows_what_is_in_effect_and_begins_with_its_first_period(self):
        taken = self.input(sample(5, 1), sample(6, 2), sample(12, 3))
        taken.skip_until(10 * MS)
        self.assertEqual((taken.latest.sequence, taken.before.sequence), (2, 2))
        taken.arrive(sample(9, 7, seat=1))
        self.assertEqual(self.fresh(taken, 20, 10), [(12, 0, 3)], "history of another seat is none")

    def test_what_arrives_late_is_new_to_a_loop_that_joined_in_between(self):
        taken = self.input(sample(5, 1), sample(6, 2))
        taken.skip_until(10 * MS)
        for again_or_late in [sample(6, 2), sample(9, 3), sample(12, 4)]:
            taken.arrive(again_or_late)
        self.assertEqual(self.fresh(taken, 20, 10), [(9, 0, 3), (12, 0, 4)])
        self.assertEqual((taken.late, taken.lost), (1, 0))

    def test_what_is_late_or_lost_is_counted(self):
        taken = self.input(sample(5, 1), sample(8, 4))
        self.fresh(taken, 10, 6)
        self.assertEqual((taken.late, taken.lost), (1, 2))

    def test_what_a_seat_says_while_it_does_not_count_is_not_missing_afterwards(self):
        taken = self.input(*(sample(at_ms, 1 + at_ms, seat=1) for at_ms in (0, 1, 2, 6, 8)))
        taken.book = SlotBook()
        for epoch, from_ms, fallback in [(1, 0, 1), (2, 3, 2), (3, 6, 1)]:
            taken.book.learn(owner(epoch, from_ms, 0, fallback=fallback))
        for at_ms in range(10):
            taken.accept(at_ms * MS, None)
        self.assertEqual(taken.lost, 1, "the one of 7 ms alone")

    def test_a_seat_that_fills_the_queue_keeps_no_other_seats_samples_out(self):
        taken = self.input(*(sample(10_000 + number, number, seat=1) for number in range(2 * CAPACITY)))
        for number in range(1, 4):
            taken.arrive(sample(10 * number, number))
            self.assertEqual(self.fresh(taken, 10 * number), [(10 * number, 0, number)])
            self.assertLessEqual(len(taken._pending), CAPACITY)

    def test_a_shadow_is_left_out(self):
        taken = self.input(sample(5, 1), sample(5, 1, seat=1), sample(15, 2, seat=1))
        taken.book = SlotBook()
        taken.book.learn(owner(1, 0, 0))
        taken.book.learn(owner(2, 10, 1))
        self.assertEqual(self.fresh(taken, 20), [(5, 0, 1), (15, 1, 2)])


class ArbiterRules(unittest.TestCase):
    LIMITS = (1.0, 0.1, 0.1, float("inf"))

    def record(
        self, epoch, effective_ms, owner_seat, fallback=NO_SEAT, kind_changed=False, watched=False
    ):
        periods_ns = (10 * MS,) * 4
        return Record(
            epoch, owner_seat, fallback, effective_ms * MS, periods_ns, kind_changed, watched
        )

    def arbiter(self, *records):
        made = CommandArbiter(self.LIMITS)
        for record in records:
            made.take_record(record)
        return made

    def at(self, arbiter, t_ms, *seats, thrust=0.0):
        """One instant: set points of these seats, then the seat that is followed, and since when."""
        t_ns = t_ms * MS
        arbiter.advance(t_ns)
        for seat in seats:
            if arbiter.may_command(seat, t_ns):
                value = (thrust, 0.0, 0.0, 0.0)
                arbiter.offer(Command(value, t_ms, seat, t_ns, t_ns + 20 * MS))
        choice = arbiter.decide(t_ns)
        return choice and (choice.seat, choice.valid_ns // MS)

    def test_until_the_new_owner_speaks_the_old_ones_last_set_point_stays_in_effect(self):
        arbiter = self.arbiter(self.record(1, 0, 0), self.record(2, 20, 1))
        self.assertEqual(self.at(arbiter, 10, 0, 1), (0, 10))
        self.assertEqual(self.at(arbiter, 20), (0, 10))
        self.assertEqual(self.at(arbiter, 25, 1, 0), (1, 25))

    def test_a_silent_owner_is_followed_by_the_fallback_until_the_next_epoch(self):
        arbiter = self.arbiter(self.record(1, 0, 0, fallback=1))
        self.assertEqual(self.at(arbiter, 10, 0, 1), (0, 10))
        self.assertEqual(self.at(arbiter, 20, 1), (0, 10))
        self.assertEqual(self.at(arbiter, 30, 1), (1, 30))
        self.assertEqual(self.at(arbiter, 40, 0), (1, 30), "latched for the epoch")
        self.assertIsNone(self.at(arbiter, 50, 0))
        arbiter.take_record(self.record(2, 60, 0, fallback=1))
        self.assertEqual(self.at(arbiter, 60, 0, 1), (0, 60))

    def test_no_other_seat_is_ever_followed(self):
        arbiter = self.arbiter(self.record(1, 0, 0))
        self.assertIsNone(self.at(arbiter, 0, 1, 2, 3))

    def test_a_record_for_an_instant_already_decided_is_refused_and_reported(self):
        arbiter = self.arbiter(self.record(1, 0, 0))
        self.at(arbiter, 20, 0)
        arbiter.take_record(self.record(2, 20, 1))
        self.assertEqual((arbiter.refused_epoch, arbiter.record.epoch), (2, 1))
        arbiter.take_record(self.record(3, 20, 0))  # It changes no hands.
        self.at(arbiter, 21, 0)
        self.assertEqual((arbiter.refused_epoch, arbiter.record.epoch), (2, 3))

    def test_a_newer_record_for_an_earlier_instant_voids_those_beyond_it(self):
        arbiter = self.arbiter(self.record(1, 0, 0), self.record(2, 80, 1))
        arbiter.take_record(self.record(3, 40, 2))
        self.at(arbiter, 200)
        self.assertEqual((arbiter.seat, arbiter.record.epoch), (2, 3))

    def test_a_change_of_kind_steps_by_the_limit_and_the_rest_comes_back(self):
        arbiter = self.arbiter(self.record(1, 0, 0), self.record(2, 20, 1, kind_changed=True))
        self.at(arbiter, 10, 0, thrust=5.0)
        self.at(arbiter, 20, 1, thrust=9.0)
        given = [arbiter.decide(t_ms * MS) for t_ms in (20, 30)]
        self.assertEqual([one.value[0] for one in given], [6.0, 9.0 - 3.0 * 0.9])
        limiter = Limiter(self.LIMITS)
        limiter.engage(0, (0.0,) * 4, (0.9, 0.1, float("nan"), 7.0))
        self.assertEqual(limiter.apply(1, (0.9, 0.1, 0.0, 7.0)), (0.9, 0.1, 0.0, 7.0))

    def test_a_loop_that_joins_begins_with_the_set_point_in_effect(self):
        arbiter = self.arbiter(self.record(1, 0, 0, fallback=1))
        arbiter.advance(10 * MS)
        arbiter.carry(Command((1.0, 0.0, 0.0, 0.0), 1, 0, 10 * MS, 30 * MS))
        self.assertEqual(self.at(arbiter, 15), (0, 10))
        self.assertFalse(arbiter.failed_over)


    def test_after_a_trip_a_watched_owner_gives_way_to_a_fallback_that_speaks(self):
        for watched, epoch, seat, expected in (
            (True, 1, 0, 1),
            (False, 1, 0, 0),
            (True, 0, 0, 0),
            (True, 2, 0, 1),
            (True, 1, 1, 0),
        ):
            arbiter = self.arbiter(self.record(1, 0, 0, 1, watched=watched))
            self.at(arbiter, 0, 0, 1)
            arbiter.trip(epoch, seat, 10 * MS)
            self.assertEqual(self.at(arbiter, 10, 0, 1), (expected, 10))
            self.assertEqual(arbiter.tripped, bool(expected))
        arbiter = self.arbiter(self.record(1, 0, 0, 1, watched=True))
        self.at(arbiter, 0, 0)
        arbiter.trip(1, 0, 10 * MS)
        self.assertIsNone(self.at(arbiter, 10, 0), "the fallback has not spoken yet")
        self.assertEqual(arbiter.forget_tripped(), 0.0, "its heading")
        arbiter.take_record(self.record(2, 20, 0, 1, watched=True))
        self.assertEqual(self.at(arbiter, 20, 0, 1), (1, 20), "the same two: the trip still counts")
        arbiter.take_record(self.record(3, 30, 0, 2, watched=True))
        self.assertEqual(self.at(arbiter, 30, 0, 1), (0, 30), "another fallback: it begins anew")
        arbiter.take_record(self.record(4, 40, 0, 2, watched=True))
        arbiter.advance(40 * MS)
        arbiter.trip(3, 0, 40 * MS)
        self.assertEqual(self.at(arbiter, 40, 0, 2), (2, 40), "a trip of before names the same two")
        arbiter = self.arbiter(self.record(1, 0, 0, 1, watched=True))
        self.at(arbiter, 0, 0, 1)
        self.assertEqual(arbiter.backup_until_ns(), 0)
        arbiter.trip(1, 0, 10 * MS)
        period_ns = arbiter.record.periods_ns[1]
        self.assertEqual(arbiter.backup_until_ns(), 10 * MS + 2 * period_ns)
        self.assertEqual(self.at(arbiter, 50, 0, 1), (1, 50))
        self.assertEqual(arbiter.backup_until_ns(), 0, "the fallback commands")
        arbiter = self.arbiter(self.record(1, 0, 0, 1, watched=True))
        self.at(arbiter, 0, 0)
        arbiter.trip(1, 0, 10 * MS)
        arbiter.reject(10 * MS)
        arbiter.take_record(self.record(2, 20, 2, 1))
        self.assertIsNone(self.at(arbiter, 20), "what has tripped is not carried over")
        arbiter = self.arbiter(self.record(1, 0, 0, watched=True))
        self.assertEqual(self.at(arbiter, 0, 0), (0, 0))
        self.assertIsNone(arbiter.forget_tripped())
        arbiter.trip(1, 0, 10 * MS)
        self.assertIsNone(self.at(arbiter, 5000, 0), "no other owner is there")


class Setpoint(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in ("thrust_n", "roll_rad", "pitch_rad", "yaw_rad")]


class SetPointRules(unittest.TestCase):
    def test_a_set_point_that_is_not_finite_is_its_writers_silence(self):
        owners = types.SimpleNamespace(before=None, fresh=[0], value_of=lambda _: record)
        record = owner(1, 0, 0, periods_ms=(10, 0, 0, 0))
        record.kind_changed = record.watched = 0
        setpoints = Input(Setpoint, list, "position", True)
        slot, trips = SetPoints(types.SimpleNamespace(weight_n=1.0, gravity_m_s2=9.81), 2), types.SimpleNamespace(before=None, fresh=[])

        def take(t_ms, roll_rad=None):
            if roll_rad is not None:
                packed = bytes(Setpoint(1.0, roll_rad, 0.0, 0.0))
                setpoints.arrive(Sample(t_ms * MS, 0, t_ms, 0, 0, packed))
            setpoints.accept(t_ms * MS, None)
            command = slot.take(t_ms * MS, owners, setpoints, trips, None, None)
            owners.fresh = []
            return command and command.sequence

        self.assertEqual(take(5, 0.1), 5)
        self.assertEqual(take(15, float("nan")), 5, "two periods are not over")
        self.assertIsNone(take(25))
        self.assertEqual(take(30, 0.1), 30)


    def test_the_last_set_point_fades_into_what_follows_the_reference(self):
        record = owner(1, 0, 0, periods_ms=(10, 0, 0, 0))
        record.kind_changed = record.watched = 0
        owners = types.SimpleNamespace(before=None, fresh=[0], value_of=lambda _: record)
        setpoints = Input(Setpoint, list, "position", True)
        slot, trips = SetPoints(types.SimpleNamespace(weight_n=1.0, gravity_m_s2=9.81), 2), types.SimpleNamespace(before=None, fresh=[])
        north = types.SimpleNamespace(w=0.5**0.5, x=0.0, y=0.0, z=0.5**0.5)
        still = (0.0, 0.0, 0.0)
        here = types.SimpleNamespace(q_wb=north, position_w_m=still, velocity_w_m_s=still)
        # To the west, which is to the left, where a tilt of 0.1 rad leads.
        west_m = (-0.981 / (2.2 * 5.5), 0.0, 0.0)
        point = types.SimpleNamespace(position_w_m=west_m, velocity_w_m_s=still, yaw_rad=1.5)
        header = types.SimpleNamespace(valid_ns=0)
        reference = types.SimpleNamespace(header=header, spacing_ns=MS, count=1, points=[point])
        taken = {}
        for t_ms in range(0, 5000, 10):
            if t_ms == 0:
                setpoints.arrive(Sample(0, 0, 1, 0, 0, bytes(Setpoint(1.0, 0.3, 0.2, 3.0))))
            setpoints.accept(t_ms * MS, None)
            command = slot.take(t_ms * MS, owners, setpoints, trips, here, reference)
            owners.fresh = []
            taken[t_ms] = command and (command.sequence, *command.value)
        self.assertIsNone(taken[30], "held for four periods")
        self.assertAlmostEqual(taken[40][2], 0.3)
        self.assertAlmostEqual(taken[540][2], -0.1 + 0.4 * math.exp(-1.0), 2)
        for is_, wanted in zip(taken[4990], (0, 1.005, -0.1, 0.0, 1.5)):
            self.assertAlmostEqual(is_, wanted, 4)


class Subscriber:
    """What the transport delivers: the node that wrote each sample, and its bytes."""

    def __init__(self, sent):
        self._sent = list(sent)

    # Of a service, its builder of subscribers, and the subscriber.

    def subscriber_builder(self):
        return self

    def buffer_size(self, _depth):
        return self

    def create(self):
        return self

    def receive(self):
        if not self._sent:
            return None
        node, packed = self._sent.pop(0)
        memory = ctypes.create_string_buffer(packed, len(packed))
        payload = types.SimpleNamespace(as_ptr=lambda: ctypes.addressof(memory), len=lambda: len(packed))
        header = types.SimpleNamespace(node_id=types.SimpleNamespace(value=node))
        return types.SimpleNamespace(header=header, payload=lambda: payload, delete=lambda: None)


class GuardRules(unittest.TestCase):
    """Only what a process in the registry writes for its own seat counts, and what the launcher writes."""

    PLANT, STRANGER, LAUNCHER = (7 << 64) | 1, (8 << 64) | 2, (9 << 64) | 3

    def setUp(self):
        class Fix(ctypes.Structure):
            LAYOUT = "0"
            _fields_ = [("before", ctypes.c_uint8 * 72), ("seat", ctypes.c_uint32), ("generation", ctypes.c_uint32)]

        class Progress(ctypes.Structure):
            LAYOUT = "0"
            _fields_ = [
                ("mark_ns", ctypes.c_uint64),
                ("quiet_until_ns", ctypes.c_uint64),
                ("end_ns", ctypes.c_uint64),
                ("served_mono_ns", ctypes.c_uint64),
                ("generation", ctypes.c_uint32),
                ("reserved", ctypes.c_uint32),
            ]

        self.fix, self.progress = Fix, Progress
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        bus = Bus.__new__(Bus)
        bus.samples = types.SimpleNamespace(
            TOPICS={"pose_fix": types.SimpleNamespace(type=Fix), "trip": types.SimpleNamespace(type=Fix)},
            Header=Fix,
            Progress=Progress,
        )
        bus.label = lambda role, seat: f"{role}-{seat}"
        bus._leader_file = pathlib.Path(folder.name, "launcher.node")
        bus._leader_file.write_text(f"{self.LAUNCHER:032x}\n")
        bus._leads = {}
        bus._registry = {self.PLANT: ("plant", 0, 2, True, MS)}
        bus._registry_reader = types.SimpleNamespace(values=list)
        bus._service = lambda _name, _type: Subscriber(self.sent)
        self.bus = bus

    def of(self, node, seat=0, generation=2, more=0):
        return node, bytes(self.fix(seat=seat, generation=generation)) + bytes(more)

    def test_a_sample_counts_from_the_seat_and_generation_that_its_writer_has(self):
        self.sent = [
            self.of(self.PLANT),
            self.of(self.STRANGER),
            self.of(self.PLANT, seat=1),
            self.of(self.PLANT, generation=3),
            self.of(self.LAUNCHER),
        ]
        expected = [self.of(self.PLANT)[1]]
        self.assertEqual([packed for _, packed in self.bus.topic("pose_fix", "plant").receive()], expected)
        self.sent = [self.of(self.PLANT)]
        self.assertEqual(self.bus.topic("pose_fix", "estimator").receive(), [], "of another role")

    def test_bytes_that_are_no_sample_are_none_of_any_process(self):
        self.sent = [(self.PLANT, b""), (self.PLANT, self.of(self.PLANT)[1][:-1]), self.of(self.PLANT, more=8)]
        self.assertEqual(self.bus.topic("pose_fix", "plant").receive(), [])

    def test_what_the_launcher_alone_writes_counts_from_those_that_have_led(self):
        self.sent = [self.of(self.PLANT), self.of(self.STRANGER), self.of(self.LAUNCHER, seat=1)]
        reader = self.bus.topic("trip", "supervisor")
        self.assertEqual([value.seat for value in reader.values()], [1])
        next_launcher = (10 << 64) | 4
        self.bus._leader_file.write_text(f"{next_launcher:032x}\n")
        self.sent = [self.of(next_launcher, seat=2), self.of(self.LAUNCHER, seat=3), self.of(self.STRANGER)]
        reader = self.bus.topic("trip", "supervisor")
        self.assertEqual([value.seat for value in reader.values()], [2, 3], "the one before may still be read")

    def test_a_hand_over_is_the_launchers_and_has_bytes_behind_its_header(self):
        self.sent = [self.of(self.STRANGER, more=3), self.of(self.LAUNCHER, more=3)]
        received = self.bus.handovers("attitude").receive()
        self.assertEqual([packed for _, packed in received], [self.of(self.LAUNCHER, more=3)[1]])

    def test_a_mark_counts_from_its_own_seat_alone(self):
        def mark(node, mark_ns, generation=2):
            return node, bytes(self.progress(mark_ns=mark_ns, served_mono_ns=5, generation=generation))

        self.sent = [mark(self.STRANGER, 1), mark(self.PLANT, 2, generation=3), mark(self.PLANT, 4)]
        self.assertEqual(list(self.bus.marks("plant", 0)()), [(4, 5, 2)])
        self.sent = [mark(self.PLANT, 4)]
        self.assertEqual(list(self.bus.marks("plant", 1)()), [], "of another seat")


class VehicleRules(unittest.TestCase):
    def test_a_deployable_angle_beyond_its_range_counts_as_its_end(self):
        law = [1.0, 0.0, 0.0]
        vehicle = Vehicle(
            {
                "mass_kg": 2.0,
                "gravity_m_s2": 10.0,
                "rotor_thrust_max_n": 10.0,
                "inertia_scale": 2.0,
                "yaw_coefficient_m": 0.1,
                "arm_length_m": [0.0, 0.01, 0.0],
                "inertia_xx_kg_m2": law,
                "inertia_yy_kg_m2": law,
                "inertia_zz_kg_m2": law,
            }
        )
        self.assertEqual(vehicle.inertia_kg_m2(0.0), [2.0, 2.0, 2.0])
        self.assertAlmostEqual(vehicle.bound_nm(0.0, 20.0)[0], 4.5)
        self.assertAlmostEqual(vehicle.bound_nm(9.0, 2.0)[0], 1.6)
        self.assertAlmostEqual(vehicle.bound_nm(9.0, 20.0)[2], 2.0)


class Configuration(unittest.TestCase):
    GAINS = {"angle_per_s": [1.0], "integral_s": 0.5}

    def configured(self, text):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "gains.toml"
            path.write_text(text)
            return configured(path, self.GAINS)

    def test_a_file_replaces_the_gains_that_it_names(self):
        self.assertEqual(self.configured("integral_s = 2.0"), {"angle_per_s": [1.0], "integral_s": 2.0})
        self.assertEqual(configured(None, self.GAINS), self.GAINS)

    def test_a_gain_that_the_law_does_not_have_is_refused_and_named(self):
        with self.assertRaisesRegex(Unfit, "there is no gain anglepers: it has angle_per_s, integral_s"):
            self.configured("anglepers = 3.0")
        with self.assertRaisesRegex(Unfit, "cannot be read"):
            self.configured("anglepers = ")


if __name__ == "__main__":
    unittest.main()
