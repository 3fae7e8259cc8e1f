//! A report as text: for the terminal, and as a page.

use super::{AuditRow, Number, Ordered, Report, Response, pictures};
use ::verdict::Grade;
use core::fmt;
use figures::results::{Document, Table, capital};
use serde_json::Value;

/// Sections, in the order shown.
const SECTIONS: [&str; 5] = ["flight", "constraints", "timing", "latency", "recording"];

impl Report {
    /// Numbers of one section, with the command that gives them all.
    fn table(&self, section: &str) -> (Table, &str) {
        let mut table = Table::new(["number", "value", "gate", ""]);
        let mut command = "";
        for number in self.numbers.iter().filter(|number| number.section == section) {
            let Number { name, value, gate, holds, .. } = number;
            let verdict = match holds {
                Some(true) => "holds",
                Some(false) => "FAILS",
                None => "",
            };
            table.push([*name, value.as_str(), gate.as_str(), verdict]);
            command = &number.command;
        }
        (table, command)
    }

    fn responses(&self) -> Table {
        let mut table = Table::new(["at s", "before", "peak", "back after s", "unit", "what"]);
        for Response { at_s, what, unit, before, peak, back_s } in &self.responses {
            let back = back_s.map_or("-".to_owned(), |s| format!("{s:.3}"));
            let [before, peak] = [before, peak].map(|error| format!("{error:.2}"));
            table.push([
                format!("{at_s:.3}"),
                before,
                peak,
                back,
                (*unit).to_owned(),
                what.clone(),
            ]);
        }
        table
    }

    fn orders(&self) -> Table {
        let mut table = Table::new(["asked s", "from s", "plan s", "order", "what came of it"]);
        let seconds = |s: &Option<f64>| s.map_or("-".to_owned(), |s| format!("{s:.3}"));
        for Ordered { asked_s, begins_s, order, planned_s, came } in &self.orders {
            table.push([
                seconds(asked_s),
                format!("{begins_s:.3}"),
                seconds(planned_s),
                order.clone(),
                came.clone(),
            ]);
        }
        table
    }

    fn swaps(&self) -> Table {
        let mut table =
            Table::new(["slot", "from", "to", "asked s", "flip s", "rms %", "bump %", "outcome"]);
        for swap in self.swaps.as_array().into_iter().flatten() {
            let text = |key: &str| swap[key].as_str().unwrap_or("-").to_owned();
            let number = |key: &str, scale: f64| {
                let number = swap[key].as_f64();
                number.map_or("-".to_owned(), |number| format!("{:.4}", number * scale))
            };
            table.push([
                text("slot"),
                text("from"),
                text("to"),
                number("requested_s", 1.0),
                number("flipped_s", 1.0),
                number("rms", 100.0),
                number("bump", 100.0),
                text("outcome"),
            ]);
        }
        table
    }

    fn audit(&self) -> Table {
        let mut table =
            Table::new(["topic", "seat", "writers", "samples", "first", "last", "gaps"]);
        for AuditRow { topic, seat, writers, samples, first, last, gaps } in &self.audit {
            let numbers =
                [*writers, *samples, *first, *last, *gaps].map(|number| number.to_string());
            table.push([topic.clone(), seat.to_string()].into_iter().chain(numbers));
        }
        table
    }

    fn machine(&self) -> Table {
        let mut table = Table::new(["fact", "value"]);
        for (name, value) in &self.facts {
            table.push([name, value]);
        }
        table
    }

    fn has_swaps(&self) -> bool {
        self.swaps.as_array().is_some_and(|swaps| !swaps.is_empty())
    }

    fn part(&self, document: Document) -> Document {
        let mut document = document.verdict(self.passes(), &self.line);
        for reason in self.verdict.reasons().iter().skip(1) {
            document = document.paragraph(&format!("Also: {}.", reason.text));
        }
        document =
            document.paragraph(&format!("From {}. Flown again by: {}", self.file, self.again));
        if !self.lacks.is_empty() {
            document = document.paragraph(&self.lacks);
        }
        if let Some(parted) = &self.parted {
            document = document.paragraph(&parted.to_string());
        }
        for section in SECTIONS {
            let (table, command) = self.table(section);
            document = document.heading(&capital(section)).table(&table);
            if section == "latency" && self.is_lockstep() {
                document = document.paragraph(LOCKSTEP);
            }
            document = document.paragraph(&format!("These numbers again: {command}"));
        }
        if !self.orders.is_empty() {
            document = document.heading("Orders").paragraph(ORDERS).table(&self.orders());
        }
        if !self.responses.is_empty() {
            document =
                document.heading("What followed").paragraph(RESPONSES).table(&self.responses());
        }
        if self.has_swaps() {
            document = document.heading("Swaps").table(&self.swaps());
        }
        document = document.heading("Pictures");
        for (_, figure) in pictures(self) {
            document = document.figure(&figure);
        }
        document =
            document.heading("Where each command's time went").text(&self.latency.to_string());
        document
            .heading("Audit")
            .table(&self.audit())
            .heading("Machine and build")
            .table(&self.machine())
    }
}

const RESPONSES: &str = "Error along the worst axis: largest in the second before, largest in the two seconds \
     after, and when it was back for good to what it was before (a dash: not in those two seconds).";

const ORDERS: &str = "When it was asked for, from when on it shows, when it was to be done, and what the vehicle made of it.";

const LOCKSTEP: &str = "Flown in lockstep: time stands still until every step is done, so that nothing is ever late. These are \
     times of this machine and no latency of a realtime flight; for that, fly with --clock realtime.";

/// Files of a folder.
#[derive(Debug, Default)]
pub struct Folder {
    /// Those that can be read, by name.
    pub reports: Vec<Report>,
    /// The others, and why not.
    pub unread: Vec<(String, String)>,
    /// Those that are not judged, and why not.
    pub left_out: Vec<(String, String)>,
}

impl Folder {
    /// In one sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self { reports, unread, left_out } = self;
        if reports.is_empty() && unread.is_empty() {
            return match left_out.len() {
                1 => "nothing is judged: the only recording is left out.".to_owned(),
                several => format!("nothing is judged: all {several} recordings are left out."),
            };
        }
        let passed = reports.iter().filter(|report| report.passes()).count();
        let is_good = passed == reports.len() && unread.is_empty();
        let grade = if is_good { Grade::Passed } else { Grade::Failed };
        let failed = reports.iter().filter(|report| !report.passes());
        let failed: Vec<_> = failed.map(|report| report.file.as_str()).collect();
        let text = match &failed[..] {
            [] => format!("{grade}  {passed} of {} flights pass", reports.len()),
            [first, rest @ ..] => {
                let more = if rest.is_empty() {
                    String::new()
                } else {
                    format!(" and {} more", rest.len())
                };
                format!("{grade}  {passed} of {} flights pass, not {first}{more}", reports.len())
            }
        };
        match unread.len() {
            0 => format!("{text}."),
            1 => format!("{text}, and a file cannot be read."),
            several => format!("{text}, and {several} files cannot be read."),
        }
    }

    /// For machines.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let unread = self.unread.iter();
        let unread = unread.map(|(file, why)| serde_json::json!({ "file": file, "error": why }));
        let left_out = self.left_out.iter();
        let left_out =
            left_out.map(|(file, why)| serde_json::json!({ "file": file, "left_out": why }));
        self.reports.iter().map(Report::to_json).chain(unread).chain(left_out).collect()
    }

    /// File by file.
    fn overview(&self) -> Table {
        let mut table = Table::new(["file", ""]);
        for report in &self.reports {
            table.push([&report.file, &report.line]);
        }
        for (file, why) in self.unread.iter().chain(&self.left_out) {
            table.push([file, why]);
        }
        table
    }
}

/// A page for people of one report or several, with the same for machines in it.
#[must_use]
pub fn document(folder: &Folder) -> String {
    let Folder { reports, unread, left_out } = folder;
    let several = reports.len() + unread.len() + left_out.len() > 1;
    let title = match &reports[..] {
        [one] if !several => format!("morphquad report: {}", one.scenario),
        flights => format!("morphquad report: {} flights", flights.len()),
    };
    let mut document = Document::new(&title);
    if several {
        let sentence = folder.sentence();
        document = document.verdict(sentence.starts_with(Grade::Passed.word()), &sentence);
        document = document.table(&folder.overview());
    }
    for report in reports {
        if several {
            document = document.heading(&report.file);
        }
        document = report.part(document);
    }
    document.json("report", &folder.to_json()).to_html()
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.line)?;
        for reason in self.verdict.reasons().iter().skip(1) {
            writeln!(f, "  also  {}", reason.text)?;
        }
        if !self.lacks.is_empty() {
            writeln!(f, "{}", self.lacks)?;
        }
        writeln!(f, "Flown again by: {}", self.again)?;
        if let Some(parted) = &self.parted {
            writeln!(f, "{parted}")?;
        }
        for section in SECTIONS {
            let (table, command) = self.table(section);
            write!(f, "\n{} (these numbers again: {command})\n{table}", capital(section))?;
            if section == "latency" && self.is_lockstep() {
                writeln!(f, "{LOCKSTEP}")?;
            }
        }
        if !self.orders.is_empty() {
            write!(f, "\nOrders. {ORDERS}\n{}", self.orders())?;
        }
        if !self.responses.is_empty() {
            write!(f, "\nWhat followed. {RESPONSES}\n{}", self.responses())?;
        }
        if self.has_swaps() {
            write!(f, "\nSwaps\n{}", self.swaps())?;
        }
        write!(f, "\nAudit\n{}\n", self.audit())?;
        let fact = |key: &str| self.facts.get(key).map_or("unknown", String::as_str);
        writeln!(
            f,
            "Flown by morphquad {} ({}) on {}, Linux {}",
            fact("version"),
            fact("git"),
            fact("cpu_model"),
            fact("kernel")
        )
    }
}
