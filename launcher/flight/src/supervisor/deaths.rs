//! Deaths, those in order and the others, and what ends processes.

use super::{Notice, Supervisor, own_state};
use crate::tap::Tap;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::Bus;
use runtime::namespace::remove_incomplete_objects;
use shared_types::{RegistryEntry, Role, Seat};
use swap::child::{Death, RunningChild, describe};
use swap::post::Post;
use swap::{FlightError, PostEvent};

/// Restarts older than this no longer count against a process \[ns\].
const RESTART_WINDOW_NS: u64 = 60_000_000_000;

/// Deaths at one instant of the flight after which a controller is not started again in place.
const DEATHS_MAX: u32 = 2;

/// How long a killed process may take to be gone \[ns\]: at once, unless the machine stands still.
const KILL_LIMIT_NS: u64 = 60_000_000_000;

/// Why nothing comes after the plant.
pub(super) const PLANT_GONE: &str =
    "the plant is the world and cannot be restarted: the flight ends";

impl Supervisor {
    #[expect(clippy::too_many_lines, reason = "one way of dying after another")]
    pub(super) fn reap_exited(
        &mut self,
        bus: &Bus,
        index: usize,
        keeps: &dyn Fn(Seat) -> bool,
        tap: &mut Tap,
        now_ns: u64,
    ) -> Result<(), FlightError> {
        let post = &mut self.posts[index];
        let Some(death) = post.child.as_mut().and_then(RunningChild::exited) else {
            return Ok(());
        };
        // One that was started before its slot has asked for it is not there any more when it does.
        let seat = post.seat;
        self.expected.retain(|own| own.seat != seat);
        let in_order = match death {
            Death::Status(status) => status.success(),
            Death::Unseen => has_left(post, tap, now_ns),
        };
        if in_order {
            let last_stderr = if post.ready { String::new() } else { post.last_stderr() };
            post.finished = true;
            post.child = None;
            let place = post.seat;
            if place.role.is_slot() {
                let left_without_hello = !post.ready && !post.scripted;
                let exit_reason = left_without_hello.then(|| {
                    let (name, last_stderr) = (post.spec.name.clone(), last_stderr);
                    format!("{name} exited with status 0 before it was ready{last_stderr}")
                });
                self.leave_registry(place, tap);
                self.events.push(PostEvent::Gone { place, exit_reason });
            }
            return Ok(());
        }
        let name = post.spec.name.clone();
        let how = describe(death);
        let last_stderr = post.last_stderr();
        post.child = None;
        remove_incomplete_objects(&self.folder);
        // What dead processes published last goes with what they leave behind.
        let mut drain = || {
            tap.drain(now_ns);
        };
        match &mut self.sweep {
            Some(sweep) => {
                drain();
                sweep.order();
            }
            None => bus.sweep_dead_processes(&mut drain),
        }
        tap.keep_state_of(post.seat, now_ns);
        let lost = |reason: String| {
            let (name, how, last_stderr) = (name.clone(), how.clone(), last_stderr.clone());
            FlightError::Lost { name, how, last_stderr, reason }
        };
        if post.seat.role == Role::Plant {
            return Err(lost(PLANT_GONE.to_owned()));
        }
        let mark_ns = tap.marks.of_seat(post.seat, post.generation);
        if post.seat.role.is_slot() {
            // A process that dies of what it meets there would do so again and again.
            let (times, there_ns) = post.died;
            post.died = if mark_ns > there_ns { (1, mark_ns) } else { (times + 1, there_ns) };
        }
        // One that has stepped, or came in flight, and has published no state, such as a controller in Python, has
        // nothing to go on from.
        let is_under_way = mark_ns > 0 || post.generation > 0 || !post.goes_on;
        let is_stateless = is_under_way && own_state(post, tap).is_none();
        let is_crash_looping = post.died.0 > DEATHS_MAX || is_stateless;
        if post.seat.role.is_slot() && (post.scripted || is_crash_looping || !keeps(post.seat)) {
            // Which process commands the slot now is not decided here.
            let place = post.seat;
            let exit_reason = (!post.scripted).then(|| format!("{name} {how}{last_stderr}"));
            post.scripted = false;
            post.ready = false;
            post.died = (0, 0);
            self.leave_registry(place, tap);
            self.events.push(PostEvent::Gone { place, exit_reason });
            return Ok(());
        }
        post.goes_on = true;
        let delay_ns = self.pause_before_restart(index, now_ns).map_err(lost)?;
        let post = &mut self.posts[index];
        post.restart_at_ns = Some(now_ns + delay_ns);
        post.ready = false;
        self.recovered += 1;
        let from = if own_state(post, tap).is_some() { " from its last state" } else { "" };
        let text = format!("{name} {how}{last_stderr}; restarting it{from}");
        self.notices.push(Notice { source: name, text });
        Ok(())
    }

    /// Counts a restart and returns how long to wait before it, or why there shall be none \[ns\].
    pub(super) fn pause_before_restart(
        &mut self,
        index: usize,
        now_ns: u64,
    ) -> Result<u64, String> {
        let post = &mut self.posts[index];
        post.restarts.retain(|at| at + RESTART_WINDOW_NS > now_ns);
        let count = post.restarts.len();
        if count >= self.policy.limit {
            return Err(format!("restarted {count} times within a minute: the flight ends"));
        }
        post.restarts.push(now_ns);
        Ok((self.policy.backoff_ns << count.min(20)).min(self.policy.backoff_max_ns))
    }

    /// Ends a process; its death is reported as an event.
    pub(crate) fn kill(&mut self, seat: Seat) {
        if let Some(post) = self.posts.iter_mut().find(|post| post.seat == seat) {
            post.scripted = true;
            if let Some(child) = &mut post.child {
                child.kill();
            }
        }
    }

    /// What a process has written to its standard error until now, for the end of a sentence.
    pub(crate) fn stderr_so_far(&self, seat: Seat) -> String {
        let post = self.posts.iter().find(|post| post.seat == seat);
        post.map(Post::stderr_so_far).unwrap_or_default()
    }

    /// Stops a process without ending it. In a slot no process waits for it any more, since another can command; one
    /// that is alone in its role is found to hang, killed and started again, as if it had been stopped from outside.
    pub(crate) fn stop(&mut self, seat: Seat, tap: &mut Tap) {
        if let Some(post) = self.posts.iter_mut().find(|post| post.seat == seat)
            && let Some(child) = &mut post.child
        {
            child.stop();
            if seat.role.is_slot() {
                self.leave_registry(seat, tap);
            }
        }
    }

    /// Ends a process and waits until it is gone, so that a scripted death has its instant.
    pub(crate) fn kill_at_once(&mut self, seat: Seat) {
        self.kill(seat);
        let post = self.posts.iter_mut().find(|post| post.seat == seat);
        let Some(child) = post.and_then(|post| post.child.as_mut()) else { return };
        let give_up_ns = mono_now_ns() + KILL_LIMIT_NS;
        while child.exited().is_none() && mono_now_ns() < give_up_ns {
            sleep_until(mono_now_ns() + 100_000);
        }
    }

    /// Kills processes that have permission to step and do not, unless they only wait for a processor; gives the roles
    /// of those that it has killed.
    pub(crate) fn kill_stalled(&mut self, stalled: &[RegistryEntry], tap: &Tap) -> Vec<Role> {
        let mut killed = Vec::new();
        for entry in stalled {
            let seat = Seat { role: entry.role, index: entry.seat };
            let post = self.posts.iter_mut().find(|post| post.seat == seat);
            let mark_ns = tap.marks.of_seat(seat, entry.generation);
            if let Some(post) = post
                && post.kill_if_hung(mark_ns)
            {
                let source = post.spec.name.clone();
                let text = format!("{source} made no progress although it could, killing it");
                self.notices.push(Notice { source, text });
                killed.push(entry.role);
            }
        }
        killed
    }

    /// Waits until nothing is freed any more; all processes are gone.
    pub(crate) fn finish_sweep(&mut self) {
        remove_incomplete_objects(&self.folder);
        if let Some(sweep) = &mut self.sweep {
            sweep.finish();
        }
    }

    /// Kills all processes, now.
    pub(crate) fn kill_all(&mut self) {
        for post in &mut self.posts {
            post.restart_at_ns = None;
            if let Some(child) = post.child.take() {
                child.end();
            }
        }
    }
}

/// True if a process whose exit status has not been seen published before that nothing will follow.
fn has_left(post: &Post, tap: &mut Tap, now_ns: u64) -> bool {
    tap.drain(now_ns);
    tap.marks.of_seat(post.seat, post.generation) == u64::MAX
}
