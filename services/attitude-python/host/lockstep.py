"""Simulated time: whole intervals as soon as they are permitted.

Nothing here depends on the wall clock: a step takes in what is in effect at its instant and nothing
later, whenever it comes to run, so a flight's bits follow from scenario and seed.
"""

from .ports import now_ns

WAIT_LIMIT_S = 0.02


def fly_lockstep(process, law):
    """Runs every release of the flight; gives the exit code."""
    loop, graph, marks = process.loop, process.graph, process.marks
    clock = process.read_clock()
    # At first, and after a wait that no other process has ended, all inputs are looked at.
    is_all = True
    while True:
        if process.is_stopped or process.timed_out:
            ending = process.ending()
            if ending is not None:
                return ending
        before_ns = loop.mark_ns
        if before_ns >= min(clock.allowed_ns, clock.end_ns) or process.timed_out:
            clock = process.read_clock()
            # Whatever was decided before time was allowed is known from here on.
            process.look_around()
        if before_ns >= process.leave_ns:
            return process.leave(is_retired=True)
        # Marks first, samples second: what a mark promises is then certainly here.
        roles = process.read_marks()
        loop.receive(None if is_all else roles)
        is_all = False
        allowed_ns = min(clock.allowed_ns, clock.end_ns, process.leave_ns)
        open_until_ns = graph.open_until_ns(marks, allowed_ns)
        while loop.mark_ns < open_until_ns:
            start_mono_ns = now_ns()
            loop.run_step(law, start_mono_ns, start_mono_ns)
        if loop.mark_ns >= clock.end_ns:
            return process.leave(is_retired=False)
        if loop.mark_ns > before_ns:
            loop.rescued += process.timed_out
            process.timed_out = False
            process.announce(before_ns, loop.mark_ns)
        else:
            process.wait(WAIT_LIMIT_S)
            is_all = process.timed_out
