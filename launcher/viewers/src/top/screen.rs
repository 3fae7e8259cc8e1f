//! The terminal: looks a few times a second, takes keys, and puts everything back in the end.

use super::draw::{Palette, Talk, draw};
use super::gauges::{Gauges, wanted};
use super::snapshot::{Snapshot, Usage};
use core::time::Duration;
use protocol::control::client::{AskError, Conversation};
use protocol::control::runs::Run;
use protocol::control::status::RunStatus;
use protocol::control::{Reply, Request};
use protocol::topic::live::{ListenError, Listening, Message};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::namespace::living_runs;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

/// From one picture to the next.
const FRAME: Duration = Duration::from_millis(250);
/// Longest wait for a message, and from one attempt to hear from another launcher to the next \[ns\].
const WAIT_NS: u64 = 100_000_000;
/// Lines of answers that are kept.
const KEPT: usize = 100;

/// Receives samples of a run on a thread of its own.
#[derive(Debug)]
pub struct GaugeReader {
    received: Arc<Mutex<(Gauges, u64)>>,
    leave: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl GaugeReader {
    /// Receives the samples of a run until dropped, from whichever launcher leads it.
    ///
    /// # Errors
    /// The run lets no client listen.
    pub fn open(run: &Run) -> Result<Self, ListenError> {
        let mut listening = Listening::to(run, &wanted(), false)?;
        let received = Arc::<Mutex<(Gauges, u64)>>::default();
        let leave = Arc::<AtomicBool>::default();
        let (into, leaves) = (Arc::clone(&received), Arc::clone(&leave));
        let led = run.clone();
        let thread = Builder::new().spawn(move || {
            while !leaves.load(Ordering::Relaxed) {
                let message = listening.next(Duration::from_nanos(WAIT_NS));
                if matches!(message, Ok(Message::Over) | Err(_)) {
                    // Another launcher may take the run over.
                    sleep_until(mono_now_ns() + WAIT_NS);
                    if let Ok(again) = Listening::to(&led, &wanted(), false) {
                        listening = again;
                    }
                    continue;
                }
                let mut received = into.lock().unwrap_or_else(PoisonError::into_inner);
                match message {
                    Ok(Message::Sample(topic, packed)) => received.0.take(topic, &packed),
                    Ok(Message::Dropped(count)) => received.1 += count,
                    _ => {}
                }
            }
        });
        let thread =
            thread.map_err(|source| ListenError::Closed { run: run.id().to_owned(), source })?;
        Ok(Self { received, leave, thread: Some(thread) })
    }

    /// What is known now.
    #[must_use]
    pub fn snapshot(&self, status: RunStatus, usage: &mut Usage, now_s: f64) -> Snapshot {
        let received = self.received.lock().unwrap_or_else(PoisonError::into_inner);
        Snapshot::of(status, &received.0, usage, now_s, received.1)
    }
}

impl Drop for GaugeReader {
    fn drop(&mut self) {
        self.leave.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// How a run is.
///
/// # Errors
/// Its launcher does not answer.
pub fn status_of(run: &Run) -> Result<RunStatus, AskError> {
    match Conversation::ask(run, &Request::Ps)?.receive()? {
        Reply::Status(status) => Ok(status),
        _ => Err(AskError::Ended { run: run.id().to_owned() }),
    }
}

/// Carries out a command line, and gives what is to be shown.
pub type Execute = fn(Vec<String>) -> Vec<String>;

/// Commands that are of use while one looks.
const ORDERS: [&str; 7] = ["swap", "rollback", "standby", "retire", "goto", "morph", "disturb"];

/// Shows a run until `q` is pressed, or a signal asks it to end.
///
/// # Errors
/// The terminal.
pub fn show(run: &Run, reader: &GaugeReader, first: RunStatus, execute: Execute) -> io::Result<()> {
    let end = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&end))?;
    }
    let mut terminal = ratatui::try_init()?;
    let shown = Screen::new(run, reader, first, execute).run(&mut terminal, &end);
    ratatui::restore();
    shown
}

/// Waits for a key, a signal or the limit; false once the terminal has gone. Then crossterm, which is asked for
/// what there is and not to wait, would try to read from it for ever.
fn await_key(keyboard: &File, limit: Duration) -> io::Result<bool> {
    let mut keyboard = [PollFd::new(keyboard, PollFlags::IN)];
    let limit = Timespec::try_from(limit).map_err(io::Error::other)?;
    match poll(&mut keyboard, Some(&limit)) {
        Ok(_) => {
            let gone = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
            Ok(!keyboard[0].revents().intersects(gone))
        }
        Err(Errno::INTR) => Ok(true),
        Err(error) => Err(error.into()),
    }
}

struct Screen<'a> {
    run: &'a Run,
    reader: &'a GaugeReader,
    status: RunStatus,
    usage: Usage,
    begin_ns: u64,
    talk: Talk,
    palette: Palette,
    execute: Execute,
    answers: (Sender<Vec<String>>, Receiver<Vec<String>>),
}

impl<'a> Screen<'a> {
    fn new(run: &'a Run, reader: &'a GaugeReader, status: RunStatus, execute: Execute) -> Self {
        Self {
            run,
            reader,
            status,
            usage: Usage::default(),
            begin_ns: mono_now_ns(),
            talk: Talk::default(),
            palette: Palette::of_environment(),
            execute,
            answers: channel(),
        }
    }

    fn run(&mut self, terminal: &mut ratatui::DefaultTerminal, end: &AtomicBool) -> io::Result<()> {
        let mut snapshot = self.look();
        let mut looked_ns = mono_now_ns();
        let keyboard = File::open("/dev/tty")?;
        while !end.load(Ordering::Relaxed) {
            for lines in self.answers.1.try_iter() {
                self.talk.lines.extend(lines);
            }
            let old = self.talk.lines.len().saturating_sub(KEPT);
            self.talk.lines.drain(..old);
            terminal.draw(|frame| draw(frame, &snapshot, &self.talk, self.palette))?;
            let elapsed = || Duration::from_nanos(mono_now_ns().saturating_sub(looked_ns));
            if !await_key(&keyboard, FRAME.saturating_sub(elapsed()))? {
                return Ok(());
            }
            while event::poll(Duration::ZERO)? {
                if let Event::Key(key) = event::read()?
                    && key.kind != KeyEventKind::Release
                    && !self.press(key)
                {
                    return Ok(());
                }
            }
            if elapsed() >= FRAME {
                snapshot = self.look();
                looked_ns = mono_now_ns();
            }
        }
        Ok(())
    }

    fn look(&mut self) -> Snapshot {
        if let Ok(status) = status_of(self.run) {
            (self.status, self.talk.over) = (status, None);
        } else {
            // What was seen last stays on the screen.
            let lives = living_runs().iter().any(|(id, _)| id == self.run.id());
            self.talk.over = Some(if lives { "no launcher answers" } else { "ended" });
        }
        let now_s = mono_now_ns().saturating_sub(self.begin_ns) as f64 / 1e9;
        self.reader.snapshot(self.status.clone(), &mut self.usage, now_s)
    }

    /// False if it is to end.
    fn press(&mut self, key: KeyEvent) -> bool {
        let control = key.modifiers.contains(KeyModifiers::CONTROL);
        if control && matches!(key.code, KeyCode::Char('c')) {
            return false;
        }
        match (&mut self.talk.typing, key.code) {
            (Some(_), KeyCode::Esc) => self.talk.typing = None,
            (Some(typed), KeyCode::Backspace) => {
                typed.pop();
            }
            (Some(typed), KeyCode::Char('u')) if control => typed.clear(),
            (Some(typed), KeyCode::Char('w')) if control => {
                let kept = typed.trim_end().rfind(' ').map_or(0, |space| space + 1);
                typed.truncate(kept);
            }
            (Some(typed), KeyCode::Up) => {
                if let Some(last) = &self.talk.last {
                    typed.clone_from(last);
                }
            }
            (Some(typed), KeyCode::Char(letter)) if !control => typed.push(letter),
            (Some(_), KeyCode::Enter) => {
                if let Some(typed) = self.talk.typing.take() {
                    self.order(&typed);
                }
            }
            (None, KeyCode::Char('q') | KeyCode::Esc) => return false,
            (None, KeyCode::Char(letter)) => self.talk.typing = begun(letter, &self.status),
            _ => {}
        }
        true
    }

    fn order(&mut self, typed: &str) {
        let mut arguments: Vec<String> = typed.split_whitespace().map(str::to_owned).collect();
        let Some(command) = arguments.first().cloned() else { return };
        if !ORDERS.contains(&command.as_str()) {
            self.talk.lines.push(format!("{command}: not from here; {}", ORDERS.join(", ")));
            return;
        }
        self.talk.lines.push(format!("> {typed}"));
        self.talk.last = Some(typed.to_owned());
        arguments.insert(0, "morphquad".to_owned());
        arguments.extend(["--run".to_owned(), self.run.id().to_owned()]);
        let (answer, execute) = (self.answers.0.clone(), self.execute);
        // A swap takes seconds; its output comes when it is over.
        let begun = Builder::new().spawn(move || {
            let _ = answer.send(execute(arguments));
        });
        if let Err(error) = begun {
            self.talk.lines.push(format!("cannot be done: {error}"));
        }
    }
}

/// What a key begins to type.
pub(super) fn begun(letter: char, status: &RunStatus) -> Option<String> {
    let slot = status.slots.first().map_or("attitude", |slot| slot.slot.as_str());
    match letter {
        's' => Some(format!("swap {slot} --to ")),
        'r' => Some(format!("rollback {slot}")),
        'd' => Some("disturb ".to_owned()),
        'm' => Some("morph ".to_owned()),
        'g' => Some("goto ".to_owned()),
        ':' => Some(String::new()),
        _ => None,
    }
}
