//! What the main loop looks at besides: unregistered publishers, loops that stand still, notices.

use super::Flight;
use super::leftovers::Leftovers;
use super::timed::Timed;
use crate::stall::{StallCheck, stalled};
use record::Severity;
use runtime::namespace::{BASE, Reservation};
use shared_types::time::s_from_ns;
use shared_types::{ClockMode, RegistryEntry, Role, Seat};
use std::collections::BTreeMap;
use std::io::Write as _;
use swap::{FlightError, Slots, standard_error};

/// How often all files of the run in shared memory are looked at \[ns\].
const FILE_LOOK_NS: u64 = 500_000_000;

/// How often it is reported that services were put back: a program that goes on removing them fills no summary.
const MAX_REMOVALS_REPORTED: u32 = 8;

/// From how long on a standstill of the launcher is reported: its readers keep what is published in a second \[ns\].
const STANDSTILL_NS: u64 = 500_000_000;

impl Flight {
    /// Names the unregistered publishers on the flight's topics; no process listens to them.
    pub(super) fn name_strays(&mut self) {
        // The launcher reads neither by itself.
        let _ = self.bus.read_registry(|_| ());
        self.clock_reader.for_each_new(|_| {});
        let strays = self.bus.strays();
        let mut services = BTreeMap::<u32, Vec<&str>>::new();
        for stray in strays.iter().skip(self.known_strays) {
            services.entry(stray.pid).or_default().push(&stray.service);
        }
        for (pid, services) in services {
            if pid == 0 {
                self.notice(
                    "further processes publish without being registered: their samples are ignored",
                );
                continue;
            }
            let comm = std::fs::read_to_string(format!("/proc/{pid}/comm"));
            let name = comm.as_deref().map_or("gone by now", str::trim);
            self.notice(&format!(
                "process {pid} ({name}) publishes without being registered on {}: its samples are ignored",
                services.join(", ")
            ));
        }
        self.known_strays = strays.len();
    }

    /// Protects what the run has in shared memory, once all processes have made theirs.
    pub(super) fn protect(&mut self) {
        if let Err(error) = self.services.protect(&self.bus) {
            self.notice(&format!(
                "services that another program removes cannot be put back: {error}"
            ));
        }
        self.reserve_memory();
    }

    /// Looks after what the run has in shared memory: at the end of a look around, because it may take milliseconds.
    pub(super) fn look_at_files(&mut self, now_ns: u64) {
        let all_files = now_ns >= self.next_file_look_ns;
        self.keep_services(all_files);
        // What joins makes objects, and so does what it talks to, a little later.
        let joined_ns = self.supervisor.joined_mono_ns();
        let has_joined = core::mem::replace(&mut self.reserved_after_ns, joined_ns) != joined_ns;
        if all_files || has_joined {
            self.reserve_memory();
        }
        if all_files {
            self.next_file_look_ns = now_ns + FILE_LOOK_NS;
            self.free_leftovers(now_ns);
        }
    }

    fn free_leftovers(&mut self, now_ns: u64) {
        let led_ns = now_ns.saturating_sub(self.begun.1);
        let Self { leftovers, tap, supervisor, .. } = self;
        let mut drain = || _ = tap.drain(now_ns);
        let folder = supervisor.folder();
        let is_freed = |left: &mut Leftovers| left.are_freed(led_ns, folder, &mut drain, now_ns);
        if leftovers.take_if(is_freed).is_some() {
            supervisor.note_swept();
        }
    }

    /// Takes the memory of what has been made since the last time, in a flight that reserves it.
    pub(super) fn reserve_memory(&mut self) {
        let Some(Err(error)) = self.reservation.as_mut().map(Reservation::extend) else { return };
        self.reservation = None;
        self.notice(&format!(
            "cannot reserve shared memory for what has joined ({error}): a program that fills {BASE} can end the flight"
        ));
    }

    /// Puts services back that are no longer there, and reports it. A process that has just been started looks for them
    /// later.
    fn keep_services(&mut self, all_files: bool) {
        let Some(removed) = self.services.put_back(&self.bus, all_files) else { return };
        let (count, most) = match &removed.put_back {
            Ok(()) => (&mut self.removals.0, MAX_REMOVALS_REPORTED),
            Err(_) => (&mut self.removals.1, 1),
        };
        *count += 1;
        if *count > most {
            return;
        }
        let what_then = match removed.put_back {
            Ok(()) => "they are there again".to_owned(),
            Err(error) => format!(
                "they cannot be put back ({error}); what flies goes on, but no process can join or be started again: \
                 end the flight"
            ),
        };
        let names = removed.names.join(", ");
        let text =
            format!("another program has removed services of this run ({names}): {what_then}");
        let at_ns = self.drained_ns;
        self.tap.sinks.note(at_ns, Severity::Warning, "launcher", &text);
        self.notice(&text);
    }

    /// Reports that this launcher itself stood still for long in realtime: what it could not record in that time is
    /// missing for that reason, and no process that died could be started again.
    pub(super) fn name_standstill(&mut self, now_ns: u64) {
        let stood_ns = now_ns.saturating_sub(self.looked_ns.replace(now_ns).unwrap_or(now_ns));
        if stood_ns < STANDSTILL_NS {
            return;
        }
        // In lockstep no process could go on beyond what this launcher had allowed.
        self.progress_at.0 = now_ns;
        if self.conductor.mode() == ClockMode::Lockstep {
            return;
        }
        let text = format!(
            "this launcher stood still for {:.1} s, stopped or without a processor: what was published meanwhile may not be \
             in the recording, and no process could be started again",
            s_from_ns(stood_ns)
        );
        let at_ns = self.drained_ns;
        self.tap.sinks.note(at_ns, Severity::Warning, "launcher", &text);
        self.notice(&text);
    }

    pub(super) fn mark_of(&self, entry: &RegistryEntry) -> u64 {
        let seat = Seat { role: entry.role, index: entry.seat };
        self.tap.marks.of_seat(seat, entry.generation)
    }

    /// Kills each process that could step and has not for too long.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub(super) fn watch_progress(&mut self, drained: u64, now_ns: u64) -> Result<(), FlightError> {
        if let Some(bar) = self.progress.as_ref().filter(|_| standard_error::is_ready()) {
            bar.set_position(drained.min(self.conductor.end_ns()) / 1_000_000);
        }
        let present: Vec<RegistryEntry> = self.supervisor.present().copied().collect();
        // Permission counts as well: a process that has just got it, after time was held, has not stood still.
        let realtime = self.conductor.mode() == ClockMode::Realtime;
        let allowed_ns = if realtime { 0 } else { self.conductor.allowed_ns() };
        let marks = present.iter().map(|entry| self.mark_of(entry));
        // So does arriving: a process may take long to start while time is held for it.
        let known = allowed_ns.wrapping_add(present.len() as u64);
        let known = known.wrapping_add(self.timed.as_ref().map_or(0, Timed::taken));
        let total = marks.fold(known, u64::wrapping_add);
        if !realtime && total != self.progress_at.1 {
            self.progress_at = (now_ns, total);
            self.newcomers.look(&present, &self.tap.marks);
        }
        let since_ns = self.progress_at.0;
        // In realtime a successor gets as long to catch up as it may then lag.
        let patience_ns = if realtime { 2 * self.lag_limit_ns } else { self.stall_limit_ns };
        if now_ns.saturating_sub(since_ns) > patience_ns {
            let check = StallCheck {
                now_mono_ns: now_ns,
                stall_ns: self.stall_limit_ns,
                lag_ns: self.lag_limit_ns,
            };
            let marks = &self.tap.marks;
            let mut stalled = match &self.timed {
                // One at a time has its turn, and all others wait for that one.
                Some(timed) => held_by(timed, &present),
                None => stalled(self.conductor.record(), &self.graph, &present, marks, check),
            };
            if !realtime {
                stalled = self.newcomers.excuse(stalled, marks);
            }
            if !stalled.is_empty() {
                self.progress_at.0 = now_ns;
                let killed = self.supervisor.kill_stalled(&stalled, &self.tap);
                if realtime && killed.contains(&Role::Monitor) {
                    self.with_slots(now_ns, Slots::unwatched)?;
                }
            }
        }
        Ok(())
    }

    /// Lets the stopwatch see what each process takes, while none has left yet.
    pub(super) fn look_at_processes(&mut self, now_ns: u64) {
        let over = self.drained_ns >= self.conductor.end_ns();
        let Some(stopwatch) = self.tap.sinks.stopwatch.as_mut() else { return };
        if over || !stopwatch.wants_look(now_ns) {
            return;
        }
        let members = self.supervisor.members().filter(|member| member.ready);
        let members = members.filter_map(|m| Some((m.seat.role, m.seat.index, m.name, m.pid?)));
        stopwatch.look(now_ns, members);
    }

    pub(super) fn publish_notices(&mut self, logical_ns: u64) {
        for notice in core::mem::take(&mut self.supervisor.notices) {
            let sinks = &mut self.tap.sinks;
            sinks.note(logical_ns, Severity::Warning, &notice.source, &notice.text);
            self.notice(&notice.text);
        }
        self.show_waiting();
    }

    pub(super) fn notice(&mut self, text: &str) {
        self.print(text);
        self.notices.push(text.to_owned());
    }

    /// Prints what need not be remembered, as soon as that is possible without waiting.
    pub(super) fn print(&mut self, text: &str) {
        // As a whole, so that what a controller prints comes before or after it.
        self.unshown.push_back(format!("morphquad: {text}\n").into_bytes());
        self.show_waiting();
    }

    /// Prints what waits for a terminal that has been stopped, or a pipe that is full, unless it would still have to.
    fn show_waiting(&mut self) {
        while let Some(line) = self.unshown.front_mut() {
            let taken = match &self.progress {
                Some(bar) if standard_error::is_ready() => {
                    bar.suspend(|| standard_error::show_some(line))
                }
                Some(_) => 0,
                None => standard_error::show_some(line),
            };
            if taken < line.len() {
                line.drain(..taken);
                return;
            }
            self.unshown.pop_front();
        }
    }

    /// Ends the progress and prints what waits, once the flight is over and recorded: nothing is held up by it any more.
    pub(super) fn show_rest(&mut self) {
        if let Some(bar) = &self.progress {
            bar.finish_and_clear();
        }
        for line in self.unshown.drain(..) {
            let _ = std::io::stderr().write_all(&line);
        }
    }
}

/// The processes that all others wait for.
fn held_by(timed: &Timed, present: &[RegistryEntry]) -> Vec<RegistryEntry> {
    let is_meant = |entry: &&RegistryEntry| {
        timed.held_by().any(|Seat { role, index }| (role, index) == (entry.role, entry.seat))
    };
    present.iter().filter(is_meant).copied().collect()
}
