"""The wall clock: each release at its instant, once its inputs are there or overdue."""

import time

from .ports import now_ns

WAIT_LIMIT_S = 0.02


def fly_realtime(process, law):
    """Runs every release that it is in time for; gives the exit code."""
    loop, graph, marks = process.loop, process.graph, process.marks
    loop.wall_ns = process.logical_ns
    # Connections take a millisecond: they are made in the countdown, not in the first step.
    process.read_marks()
    loop.receive(None)
    while (ending := process.ending()) is None:
        process.read_clock()
        process.look_around()
        before_ns = t_ns = loop.mark_ns
        if t_ns >= process.leave_ns or t_ns >= process.clock.end_ns:
            return process.leave(is_retired=t_ns >= process.leave_ns)
        process.read_marks()
        deadline_ns = graph.missing_deadline_ns(marks, t_ns)
        due_mono_ns, until_mono_ns = process.mono_ns(t_ns), process.mono_ns(t_ns + deadline_ns)
        start_mono_ns = now_ns()
        if deadline_ns > 0 and start_mono_ns < until_mono_ns:
            process.wait(min((until_mono_ns - start_mono_ns) * 1e-9, WAIT_LIMIT_S))
        elif start_mono_ns < due_mono_ns:
            time.sleep(min((due_mono_ns - start_mono_ns) * 1e-9, WAIT_LIMIT_S))
        else:
            # An old command is worth nothing: goes on with the newest release that is due.
            loop.skip_to(process.logical_ns(start_mono_ns))
            if loop.mark_ns == before_ns:
                loop.missed += deadline_ns > 0
                loop.receive(None)
                loop.run_step(law, start_mono_ns, due_mono_ns)
            process.announce(before_ns, loop.mark_ns)
    return ending
