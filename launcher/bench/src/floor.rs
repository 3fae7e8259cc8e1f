//! The machine's own noise, in the same run: a timer loop as `cyclictest` has it, and a ping over bare
//! iceoryx2, at the rates, with the policy and on the processors of the flight's loops.
//!
//! Two processes: one has the timers and sends, the other receives. Their instants lie between those of
//! the flight, so that neither makes the other wait.

use super::peer::floor::{Beat, FromAnswer, FromOrder, Payload, Ping, ToOrder};
use super::peer::{Peer, PeerRequest, Seat as ThreadSeat};
use super::place::Place;
use super::series::Series;
use super::{BenchError, run_id};
use observe::stopwatch::OnStart;
use protocol::control::runs::note_measurement;
use runtime::namespace::Membership;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Where in the millisecond after the flight's instants the timers' instants lie, and those of the pings,
/// which take longer \[ns\]: none may meet another.
const TIMER_PHASES_NS: [u64; 2] = [300_000, 480_000];
const PING_PHASES_NS: [u64; 2] = [500_000, 940_000];

/// What to measure: rates of timers \[Hz\], and pings by name.
#[derive(Debug, Clone, Default)]
pub struct FloorPlan {
    /// Rates \[Hz\].
    pub timers: Vec<f64>,
    /// Name, payload and rate \[Hz\].
    pub pings: Vec<(&'static str, Payload, f64)>,
}

/// A floor under way.
#[derive(Debug)]
pub struct Floor {
    from: Arc<Mutex<Peer>>,
    to: Arc<Mutex<Peer>>,
    /// Dropped last: it wipes the folder.
    _run: Membership,
}

/// What was measured: instant \[ns\] and duration \[ns\] of each.
#[derive(Debug, Clone, Default)]
pub struct FloorData {
    /// Lateness of each timer, with its rate \[Hz\].
    pub timers: Vec<(f64, Vec<(u64, u64)>)>,
    /// Hops of each ping, with its name.
    pub pings: Vec<(String, Vec<(u64, u64)>)>,
}

impl Floor {
    /// Starts both processes; they wait until they receive the start time.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn prepare(plan: &FloorPlan, place: &Place) -> Result<Self, BenchError> {
        let run = Membership::found(&run_id())?;
        note_measurement(run.folder()).map_err(|source| BenchError::System {
            action: "write the run's folder".to_owned(),
            source,
        })?;
        let beat = |[first_ns, end_ns]: [u64; 2], (index, count): (usize, usize), rate_hz| Beat {
            rate_hz,
            phase_ns: first_ns + (end_ns - first_ns) * index as u64 / count as u64,
            fifo: place.fifo().map(|base| priority(base, rate_hz, &plan.timers)),
        };
        let timers: Vec<Beat> = plan
            .timers
            .iter()
            .enumerate()
            .map(|(index, hz)| beat(TIMER_PHASES_NS, (index, plan.timers.len()), *hz))
            .collect();
        let pings: Vec<Ping> = plan
            .pings
            .iter()
            .enumerate()
            .map(|(index, (name, payload, hz))| Ping {
                name: (*name).to_owned(),
                payload: *payload,
                beat: beat(PING_PHASES_NS, (index, plan.pings.len()), *hz),
            })
            .collect();
        let seat = ThreadSeat { cpu: None, fifo: place.fifo(), like_a_loop: true };
        let folder = run.folder().to_path_buf();
        let from = FromOrder { run: folder.clone(), seat, timers, pings: pings.clone() };
        let from = Peer::start(&PeerRequest::FloorFrom(from))?;
        let to = Peer::start(&PeerRequest::FloorTo(ToOrder { run: folder, seat, pings }))?;
        Ok(Self { from: Arc::new(Mutex::new(from)), to: Arc::new(Mutex::new(to)), _run: run })
    }

    /// To be called with the instant of the flight's start \[ns\].
    #[must_use]
    pub fn starter(&self) -> OnStart {
        let (from, to) = (Arc::clone(&self.from), Arc::clone(&self.to));
        Box::new(move |start_mono_ns| {
            for peer in [from, to] {
                // One that has gone is missed at the end.
                let _ = held(&peer).send_line(&start_mono_ns.to_string());
            }
        })
    }

    /// Ends it.
    ///
    /// # Errors
    /// A process has gone.
    pub fn finish(self) -> Result<FloorData, BenchError> {
        let from: FromAnswer = held(&self.from).stop()?;
        let pings = held(&self.to).stop()?;
        Ok(FloorData { timers: from, pings })
    }
}

/// Priority of a loop of this rate: the slowest have `base`, each faster rate one more.
fn priority(base: u8, rate_hz: f64, rates: &[f64]) -> u8 {
    let slower = rates.iter().filter(|hz| **hz < rate_hz).count();
    u8::try_from(usize::from(base) + slower).unwrap_or(99).min(99)
}

fn held(peer: &Mutex<Peer>) -> MutexGuard<'_, Peer> {
    // A thread that panicked with the lock leaves nothing half done.
    peer.lock().unwrap_or_else(PoisonError::into_inner)
}

impl FloorData {
    /// Lateness of the timer of the nearest rate, within these instants \[ns\].
    #[must_use]
    pub fn lateness(&self, rate_hz: f64, within: [u64; 2]) -> Series {
        self.timer(rate_hz, within).map(|(_, late_ns)| late_ns).collect()
    }

    /// How far each period of that timer was from what it should have been.
    #[must_use]
    pub fn period_deviation(&self, rate_hz: f64, within: [u64; 2]) -> Series {
        let late: Vec<u64> = self.timer(rate_hz, within).map(|(_, late_ns)| late_ns).collect();
        // Both of a pair were due a period apart.
        late.windows(2).map(|pair| pair[1].abs_diff(pair[0])).collect()
    }

    fn timer(&self, rate_hz: f64, within: [u64; 2]) -> impl Iterator<Item = (u64, u64)> {
        let distance = |hz: f64| (hz - rate_hz).abs();
        let nearest = self.timers.iter().min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
        in_window(nearest.map(|(_, values)| values.as_slice()).unwrap_or_default(), within)
    }

    /// Hops of a ping within these instants \[ns\].
    #[must_use]
    pub fn hops(&self, name: &str, within: [u64; 2]) -> Series {
        let found = self.pings.iter().find(|(known, _)| known == name);
        let values = found.map(|(_, values)| values.as_slice()).unwrap_or_default();
        in_window(values, within).map(|(_, hop_ns)| hop_ns).collect()
    }
}

fn in_window(
    values: &[(u64, u64)],
    [from_ns, to_ns]: [u64; 2],
) -> impl Iterator<Item = (u64, u64)> {
    values.iter().copied().filter(move |(at_ns, _)| (from_ns..to_ns).contains(at_ns))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_floor_has_the_priority_of_the_loops_of_its_rate() {
        let rates = [1000.0, 50.0, 500.0];
        let of = |hz| priority(10, hz, &rates);
        assert_eq!([of(50.0), of(500.0), of(1000.0)], [10, 11, 12]);
        assert_eq!(priority(98, 1000.0, &rates), 99);
    }

    #[test]
    fn a_floor_is_what_was_measured_within_the_window_at_the_nearest_rate() {
        let slow = (0..10).map(|k| (k * 20, 500 + k)).collect();
        let fast = (0..100).map(|k| (k * 2, 1000 + 10 * (k % 2))).collect();
        let pings = vec![("imu".to_owned(), vec![(5, 7000), (50, 9000)])];
        let data = FloorData { timers: vec![(50.0, slow), (500.0, fast)], pings };
        assert_eq!(data.lateness(490.0, [20, 120]).len(), 50);
        assert_eq!(data.lateness(60.0, [20, 120]).len(), 5);
        let deviation = data.period_deviation(500.0, [0, 200]).quantiles().unwrap();
        assert_eq!((deviation.n, deviation.p50_us, deviation.max_us), (99, 0.01, 0.01));
        assert_eq!(data.hops("imu", [0, 10]).quantiles().map(|q| q.n), Some(1));
        assert!(data.hops("none", [0, 10]).is_empty());
    }
}
