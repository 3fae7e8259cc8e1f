//! A snapshot as a screen of 80 columns and 24 lines, or more.

use super::gauges::Spread;
use super::{Row, Snapshot};
use core::fmt::Write as _;
use protocol::control::status::{ProcessState, RunStatus};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

/// What can be typed, for the last line.
const KEYS: &str = "s swap  r roll back  d disturb  m morph  g goto  : command  q quit";

/// What is on the screen besides the snapshot.
#[derive(Debug, Clone, Default)]
pub struct Talk {
    /// What was answered last, oldest first.
    pub lines: Vec<String>,
    /// The command that is being typed.
    pub typing: Option<String>,
    /// The command typed last, for another time.
    pub last: Option<String>,
    /// What has become of the run, once its launcher does not answer.
    pub over: Option<&'static str>,
}

/// Colours, or none where they are not wanted.
#[derive(Debug, Clone, Copy)]
pub struct Palette {
    colours: bool,
}

impl Palette {
    /// Colours unless `NO_COLOR` is set to something.
    #[must_use]
    pub fn of_environment() -> Self {
        Self { colours: std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()) }
    }

    /// Without colours.
    #[must_use]
    pub fn plain() -> Self {
        Self { colours: false }
    }

    fn style(self, colour: Color) -> Style {
        if self.colours { Style::new().fg(colour) } else { Style::new() }
    }

    /// Colours that differ also for those who see no red or green; the text shows the state, too.
    fn state(self, state: ProcessState) -> Style {
        match state {
            ProcessState::Owner => self.style(Color::Cyan),
            ProcessState::Fallback | ProcessState::Shadow => self.style(Color::Blue),
            ProcessState::Restarting => self.style(Color::Yellow).add_modifier(Modifier::BOLD),
            _ => Style::new(),
        }
    }

    fn alarm(self, alarmed: bool) -> Style {
        if alarmed { self.style(Color::Yellow).add_modifier(Modifier::BOLD) } else { Style::new() }
    }
}

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, snapshot: &Snapshot, talk: &Talk, palette: Palette) {
    let slot_lines = slots_of(&snapshot.status);
    let slots = u16::try_from(slot_lines.len()).unwrap_or(0);
    let loops = u16::try_from(snapshot.loops.len()).unwrap_or(0);
    let [head, table, slots, talked, keys] = Layout::vertical([
        Constraint::Length(3),
        Constraint::Length(loops + 2),
        Constraint::Length(slots + 1),
        Constraint::Min(1),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    frame.render_widget(Paragraph::new(head_of(snapshot, talk, palette, head.width)), head);
    frame.render_widget(Paragraph::new(table_of(snapshot, palette)), table);
    frame.render_widget(Paragraph::new(slot_lines), slots);
    let room = usize::from(talked.height);
    let kept = talk.lines.len().saturating_sub(room);
    let newest: Vec<Line<'_>> =
        talk.lines[kept..].iter().map(|line| Line::from(cut(line, talked.width.into()))).collect();
    frame.render_widget(Paragraph::new(newest), talked);
    let last = match &talk.typing {
        Some(typed) => Line::from(vec![
            Span::styled("> ", Style::new().add_modifier(Modifier::BOLD)),
            Span::raw(tail(typed, usize::from(keys.width).saturating_sub(3))),
            Span::styled(" ", Style::new().add_modifier(Modifier::REVERSED)),
            Span::styled(hint(typed), Style::new().add_modifier(Modifier::DIM)),
        ]),
        None => Line::styled(KEYS, Style::new().add_modifier(Modifier::DIM)),
    };
    frame.render_widget(Paragraph::new(last), keys);
}

/// What may follow a command of which nothing but its name stands there.
fn hint(typed: &str) -> &'static str {
    match typed.split_whitespace().collect::<Vec<_>>()[..] {
        ["disturb"] => "force 0 0 -0.2 --for 500ms",
        ["morph"] => "120 --over 2s",
        ["goto"] => "1 0 2 90",
        ["swap", _, "--to"] => "attitude-lqr",
        _ => "",
    }
}

/// A text that shows where it is cut.
fn cut(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    text.chars().take(width.saturating_sub(1)).chain(['…']).collect()
}

/// The end of a text that is too long.
fn tail(text: &str, width: usize) -> String {
    let count = text.chars().count();
    text.chars().skip(count.saturating_sub(width)).collect()
}

fn head_of(snapshot: &Snapshot, talk: &Talk, palette: Palette, width: u16) -> Vec<Line<'static>> {
    let RunStatus { run, scenario, clock, started, flown_s, end_s, .. } = &snapshot.status;
    let stage = match (talk.over, started) {
        (Some(over), _) => over,
        (None, true) => "running",
        (None, false) => "getting ready",
    };
    let share = if *end_s > 0.0 { (flown_s / end_s).clamp(0.0, 1.0) } else { 0.0 };
    let time = format!(" {flown_s:.1} of {end_s:.1} s");
    let room = usize::from(width).saturating_sub(time.len() + 2);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1")]
    let filled = (share * room as f64) as usize;
    let bar = format!("[{}{}]", "#".repeat(filled), " ".repeat(room.saturating_sub(filled + 1)));
    let mut title = vec![
        Span::styled(
            format!("run {run}  {scenario}, {clock}, "),
            Style::new().add_modifier(Modifier::BOLD),
        ),
        Span::styled(stage, palette.alarm(talk.over.is_some())),
    ];
    if snapshot.dropped > 0 {
        title.push(Span::styled(format!("  {} unseen", snapshot.dropped), palette.alarm(true)));
    }
    vec![Line::from(title), Line::from(format!("{bar}{time}")), Line::default()]
}

fn table_of(snapshot: &Snapshot, palette: Palette) -> Vec<Line<'static>> {
    let head = cells(
        &["LOOP", "STATE", "EP", "GEN", "HZ", "LATE", "STEP", "AGE", "MISS", "Q", "CPU", "MB"]
            .map(str::to_owned),
    );
    let mut lines = vec![Line::styled(head, Style::new().add_modifier(Modifier::UNDERLINED))];
    for row in &snapshot.loops {
        let text = cells(&columns(row));
        // Name and state have a width of their own, so that only the state is coloured.
        let (name, rest) = text.split_at(text.char_indices().nth(16).map_or(0, |(at, _)| at));
        let (state, rest) = rest.split_at(rest.char_indices().nth(11).map_or(0, |(at, _)| at));
        lines.push(Line::from(vec![
            Span::raw(name.to_owned()),
            Span::styled(state.to_owned(), palette.state(row.state)),
            Span::styled(rest.to_owned(), palette.alarm(row.gauge.missed > 0 && row.queue > 1)),
        ]));
    }
    lines
}

/// One line of the table, 78 columns wide.
fn cells(columns: &[String; 12]) -> String {
    const WIDTHS: [usize; 12] = [15, 10, 3, 3, 5, 5, 5, 5, 4, 3, 5, 4];
    let mut line = String::new();
    for (place, (cell, width)) in columns.iter().zip(WIDTHS).enumerate() {
        let cell = short(cell, width);
        let _ = match place {
            0 | 1 => write!(line, "{cell:<width$} "),
            _ => write!(line, "{cell:>width$} "),
        };
    }
    line.trim_end().to_owned()
}

fn short(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    let kept: String = text.chars().take(width.saturating_sub(1)).collect();
    format!("{kept}~")
}

fn columns(row: &Row) -> [String; 12] {
    let name =
        if row.epoch.is_some() { format!("{}@{}", row.name, row.seat) } else { row.name.clone() };
    let none = || "-".to_owned();
    [
        name,
        row.state.label().to_owned(),
        row.epoch.map_or_else(none, |epoch| epoch.to_string()),
        row.generation.to_string(),
        row.gauge.hz.map_or_else(none, |hz| format!("{hz:.0}")),
        row.gauge.lateness.map_or_else(none, time),
        row.gauge.compute.map_or_else(none, time),
        row.gauge.input_age.map_or_else(none, time),
        count(row.gauge.missed),
        count(row.queue),
        row.cpu_percent.map_or_else(none, |percent| format!("{percent:.1}")),
        row.rss_bytes.map_or_else(none, |bytes| (bytes >> 20).to_string()),
    ]
}

/// The middle, with its unit: five columns.
fn time(spread: Spread) -> String {
    let us = spread.median_us;
    if us < 100.0 {
        format!("{us:.1}u")
    } else if us < 10_000.0 {
        format!("{us:.0}u")
    } else if us < 1e6 {
        format!("{:.0}m", us / 1e3)
    } else {
        format!("{:.0}s", us / 1e6)
    }
}

fn count(count: u64) -> String {
    match count {
        0..10_000 => count.to_string(),
        10_000..1_000_000 => format!("{}k", count / 1000),
        _ => format!("{}M", count / 1_000_000),
    }
}

fn slots_of(status: &RunStatus) -> Vec<Line<'static>> {
    let mut lines = Vec::new();
    for slot in &status.slots {
        let owner = slot.owner.as_deref().unwrap_or("none");
        let watched = if slot.watched { " (watched)" } else { "" };
        let owner = format!("{owner}{watched}");
        let fallback = slot.fallback.as_deref().unwrap_or("-");
        lines.push(Line::from(format!(
            "{:<9} epoch {:<4} owner {owner:<30} fallback {fallback}",
            slot.slot, slot.epoch
        )));
        let course = slot.course();
        if !course.is_empty() {
            lines.push(Line::from(format!("  {course}")));
        }
    }
    lines
}

/// The same for a pipe: lines without a trace of a terminal.
#[must_use]
pub fn plain(snapshot: &Snapshot) -> String {
    let talk = Talk::default();
    let head = head_of(snapshot, &talk, Palette::plain(), 80);
    let lines =
        head.into_iter().chain(table_of(snapshot, Palette::plain())).chain([Line::default()]);
    let mut text = String::new();
    for line in lines.chain(slots_of(&snapshot.status)) {
        let _ = writeln!(text, "{}", line.to_string().trim_end());
    }
    text
}
