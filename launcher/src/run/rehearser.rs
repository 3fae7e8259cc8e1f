//! Rehearsals of swap candidates: each flies in a child of the launcher, off every loop.

use crate::own_executable::OWN_EXECUTABLE;
use crate::rehearse::{RehearsalRefusal, RehearsalSpec, Verdict};
use shared_types::Seat as Place;
use std::io::{self, Read as _, Write as _};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

/// How much a rehearsal beside a realtime flight stands back for loops without a priority of their own.
/// On a machine whose processors are all busy this still leaves it a twentieth of one.
const NICE: i32 = 10;
/// From the wall time after which the child answers by itself to the time when it is ended \[ns\].
const SLACK_NS: u64 = 2_000_000_000;

/// The rehearsals that are going on, at most one per instance.
#[derive(Debug, Default)]
pub(crate) struct Rehearser {
    running: Vec<Running>,
    /// In realtime, so that no loop waits for it.
    stands_back: bool,
}

#[derive(Debug)]
struct Running {
    place: Place,
    child: Child,
    /// Reads what it says on standard output and on standard error.
    listeners: [Option<JoinHandle<String>>; 2],
    give_up_ns: u64,
}

impl Rehearser {
    /// None yet; in realtime they stand back for the flight.
    pub(crate) fn new(stands_back: bool) -> Self {
        Self { running: Vec::new(), stands_back }
    }

    /// Begins to fly a candidate ahead, which may take `wall_max_s`; whatever is flown for that instance
    /// ends.
    ///
    /// # Errors
    /// The child cannot be started.
    pub(crate) fn begin(
        &mut self,
        place: Place,
        spec: &RehearsalSpec,
        (now_mono_ns, wall_max_s): (u64, f64),
    ) -> io::Result<()> {
        self.end(place);
        let child = start(spec, if self.stands_back { NICE } else { 0 })?;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "checked settings"
        )]
        let wall_max_ns = (wall_max_s * 1e9) as u64;
        let give_up_ns = now_mono_ns.saturating_add(wall_max_ns).saturating_add(SLACK_NS);
        let (child, listeners) = child;
        self.running.push(Running { place, child, listeners, give_up_ns });
        Ok(())
    }

    /// Verdicts that have come since the last time.
    pub(crate) fn take(&mut self, now_mono_ns: u64) -> Vec<(Place, Verdict)> {
        let over = |running: &mut Running| {
            let late = now_mono_ns > running.give_up_ns;
            late || !matches!(running.child.try_wait(), Ok(None))
        };
        self.running.extract_if(.., over).map(Running::verdict).collect()
    }

    /// Ends the rehearsal for an instance, whose verdict is no longer wanted.
    pub(crate) fn end(&mut self, place: Place) {
        self.running.retain(|running| running.place != place);
    }
}

/// A child that has been told what to fly, and who listens to it.
fn start(spec: &RehearsalSpec, nice: i32) -> io::Result<(Child, [Option<JoinHandle<String>>; 2])> {
    let told = serde_json::to_vec(spec).map_err(io::Error::other)?;
    let mut child = Command::new(OWN_EXECUTABLE)
        .args(["rehearse", "--spec", "-", "--nice", &nice.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    let stdin = child.stdin.take();
    // A specification may be longer than a pipe holds, and the flight waits for nobody who reads slowly.
    std::thread::spawn(move || stdin.map(|mut stdin| stdin.write_all(&told)));
    let listeners = [
        child.stdout.take().map(|pipe| listen(Box::new(pipe))),
        child.stderr.take().map(|pipe| listen(Box::new(pipe))),
    ];
    Ok((child, listeners))
}

fn listen(mut pipe: Box<dyn io::Read + Send>) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut text = Vec::new();
        // What has been said until a pipe breaks is all that there is.
        let _ = pipe.read_to_end(&mut text);
        String::from_utf8_lossy(&text).into_owned()
    })
}

impl Running {
    /// What it said, once it has ended or its time is over.
    fn verdict(mut self) -> (Place, Verdict) {
        // It has ended, or has to.
        let _ = self.child.kill();
        let status = self.child.wait();
        let [said, words] = self.listeners.each_mut().map(|listener| {
            listener.take().and_then(|listener| listener.join().ok()).unwrap_or_default()
        });
        let verdict = serde_json::from_str(said.trim()).unwrap_or_else(|_| {
            let how = status.map_or("it is gone".to_owned(), |status| status.to_string());
            let why = match words.trim() {
                "" => format!("the rehearsal ended without a verdict ({how})"),
                words => format!("the rehearsal ended without a verdict ({how}): {words}"),
            };
            Verdict::of(
                "the candidate",
                "the owner",
                Err(Box::new(RehearsalRefusal::NotRehearsed { why })),
            )
        });
        (self.place, verdict)
    }
}

/// Nobody wants the verdict any more.
impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
