"""The launcher of a run, and the next one once it has died."""

import os
import pathlib
import select
import signal
import threading
import time

# Longest wait between two looks for the next launcher, and how long a process may take to leave when there is
# none [s].
LOOK_EVERY_S = 0.05
LEAVE_LIMIT_S = 10.0


def process_start(pid):
    """When a living process was started, in ticks since the system was; None for one that has ended."""
    try:
        stat = pathlib.Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return None
    # The name, in parentheses, may hold anything; the state is field 3, the start field 22.
    fields = stat.rpartition(")")[2].split()
    return None if fields[0] in "ZX" else int(fields[19])


def leader_of(run):
    """Process and start of the launcher that last claimed to lead the run of this folder; None if none has."""
    try:
        pid, started = (run / "launcher.lock").read_text().split()
        return int(pid), int(started)
    except (OSError, ValueError):
        return None


class Launcher:
    """Watches the launcher from a thread of its own, so that a controller that hangs does not stay for ever, unless it
    hangs in a library that keeps Python's lock."""

    def __init__(self, run, pid, leave_s):
        """`leave_s` returns, when it has died, how long after that there is none to come any more [s]."""
        self._run, self._leave_s = run, leave_s
        # It has died, and no other has taken over yet; none will.
        self.is_gone = self.is_given_up = False
        watched = os.pidfd_open(pid), (pid, process_start(pid))
        threading.Thread(target=self._follow, args=watched, name="watch", daemon=True).start()

    def _follow(self, pidfd, leader):
        while pidfd is not None:
            ended = select.poll()
            ended.register(pidfd, select.POLLIN)
            ended.poll()
            os.close(pidfd)
            self.is_gone = True
            pidfd, leader = self._await_successor(leader)
            self.is_gone = pidfd is None
        self.is_given_up = True
        time.sleep(LEAVE_LIMIT_S)
        os.kill(os.getpid(), signal.SIGKILL)

    def _await_successor(self, dead):
        limit_s = time.monotonic() + self._leave_s()
        while True:
            leader = leader_of(self._run)
            if leader is not None and leader != dead:
                try:
                    pidfd = os.pidfd_open(leader[0])
                except OSError:
                    pidfd = None
                # Read after the process has been caught: a process id that was reused is recognised by it.
                if pidfd is not None and process_start(leader[0]) == leader[1]:
                    return pidfd, leader
                if pidfd is not None:
                    os.close(pidfd)
            left_s = limit_s - time.monotonic()
            if left_s <= 0.0:
                return None, dead
            time.sleep(min(LOOK_EVERY_S, left_s))
