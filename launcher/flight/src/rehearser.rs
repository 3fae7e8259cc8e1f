//! Runs the rehearsals of swap candidates, each in a child process of the launcher, so that no loop waits.

use scenario::process::OWN_EXECUTABLE;
use shared_types::Seat as Place;
use shared_types::time::ns_from_s;
use simulate::rehearse::{RehearsalRefusal, Verdict};
use std::io::{self, Read as _, Write as _};
use std::process::{Child, Command, Stdio};
use std::thread::{Builder, JoinHandle};
use swap::RehearsalSpec;

/// Nice value of a rehearsal during a realtime flight, so that it yields to loops without a realtime priority.
/// On a machine whose processors are all busy it still gets a twentieth of one.
const NICE: i32 = 10;
/// Wall time that the child has beyond its own time limit before it is killed \[ns\].
const SLACK_NS: u64 = 2_000_000_000;

/// The running rehearsals, at most one per instance.
#[derive(Debug, Default)]
pub(crate) struct Rehearser {
    running: Vec<Running>,
    /// True in realtime, where rehearsals run with the nice value [`NICE`].
    stands_back: bool,
}

#[derive(Debug)]
struct Running {
    place: Place,
    child: Child,
    /// Threads that read its standard output and standard error.
    listeners: [Option<JoinHandle<String>>; 2],
    give_up_ns: u64,
}

impl Rehearser {
    /// No rehearsals yet. With `stands_back`, for realtime flights, they run with a nice value.
    pub(crate) fn new(stands_back: bool) -> Self {
        Self { running: Vec::new(), stands_back }
    }

    /// Starts to rehearse a candidate, which may take `wall_max_s` of wall time; a running rehearsal for the
    /// same instance is ended.
    ///
    /// # Errors
    /// If the child process cannot be started.
    pub(crate) fn begin(
        &mut self,
        place: Place,
        spec: &RehearsalSpec,
        (now_mono_ns, wall_max_s): (u64, f64),
    ) -> io::Result<()> {
        self.end(place);
        let child = start(spec, if self.stands_back { NICE } else { 0 })?;
        let wall_max_ns = ns_from_s(wall_max_s);
        let give_up_ns = now_mono_ns.saturating_add(wall_max_ns).saturating_add(SLACK_NS);
        let (child, listeners) = child;
        self.running.push(Running { place, child, listeners, give_up_ns });
        Ok(())
    }

    /// Verdicts of the rehearsals that have ended since the last call.
    pub(crate) fn take(&mut self, now_mono_ns: u64) -> Vec<(Place, Verdict)> {
        let over = |running: &mut Running| {
            let late = now_mono_ns > running.give_up_ns;
            late || !matches!(running.child.try_wait(), Ok(None))
        };
        self.running.extract_if(.., over).map(Running::verdict).collect()
    }

    /// Ends the rehearsal for an instance whose verdict is no longer needed.
    pub(crate) fn end(&mut self, place: Place) {
        self.running.retain(|running| running.place != place);
    }
}

/// Starts a child process with a specification, and the threads that read its output.
fn start(spec: &RehearsalSpec, nice: i32) -> io::Result<(Child, [Option<JoinHandle<String>>; 2])> {
    let json = serde_json::to_vec(spec).map_err(io::Error::other)?;
    let mut child = Command::new(OWN_EXECUTABLE)
        .args(["rehearse", "--spec", "-", "--nice", &nice.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    match talk(&mut child, json) {
        Ok(listeners) => Ok((child, listeners)),
        Err(error) => {
            let _ = child.kill();
            let _ = child.wait();
            Err(error)
        }
    }
}

/// Threads that write to a child and listen to it.
fn talk(child: &mut Child, json: Vec<u8>) -> io::Result<[Option<JoinHandle<String>>; 2]> {
    let stdin = child.stdin.take();
    // A specification may be longer than the buffer of a pipe; writing it here would block the flight until
    // the child has read it.
    thread().spawn(move || stdin.map(|mut stdin| stdin.write_all(&json)))?;
    Ok([
        child.stdout.take().map(|pipe| listen(Box::new(pipe))).transpose()?,
        child.stderr.take().map(|pipe| listen(Box::new(pipe))).transpose()?,
    ])
}

fn thread() -> Builder {
    Builder::new().name("rehearsal".to_owned())
}

fn listen(mut pipe: Box<dyn io::Read + Send>) -> io::Result<JoinHandle<String>> {
    thread().spawn(move || {
        let mut text = Vec::new();
        // After an error on the pipe, the text read so far is still useful.
        let _ = pipe.read_to_end(&mut text);
        String::from_utf8_lossy(&text).into_owned()
    })
}

impl Running {
    /// The verdict of a child that has ended or has exceeded its time.
    fn verdict(mut self) -> (Place, Verdict) {
        // A child that has exceeded its time must end now; one that has ended is not affected.
        let _ = self.child.kill();
        let status = self.child.wait();
        let [stdout, stderr] = self.listeners.each_mut().map(|listener| {
            listener.take().and_then(|listener| listener.join().ok()).unwrap_or_default()
        });
        let verdict = serde_json::from_str(stdout.trim()).unwrap_or_else(|_| {
            let how = status.map_or("it is gone".to_owned(), |status| status.to_string());
            let why = match stderr.trim() {
                "" => format!("the rehearsal ended without a verdict ({how})"),
                stderr => format!("the rehearsal ended without a verdict ({how}): {stderr}"),
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

/// The verdict is no longer needed, so that the child is killed and reaped.
impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
