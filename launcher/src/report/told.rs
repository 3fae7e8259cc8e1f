//! A report in words: for the terminal, and as a page.

use super::{AuditRow, Number, Report, Response, pictures};
use crate::results::{Document, Table};
use core::fmt;
use serde_json::Value;

/// Sections, in the order told.
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
            table.push([*name, value.as_str(), *gate, verdict]);
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

    fn swaps(&self) -> Table {
        let mut table =
            Table::new(["slot", "from", "to", "asked s", "flip s", "bump %", "outcome"]);
        for swap in self.swaps.as_array().into_iter().flatten() {
            let word = |key: &str| swap[key].as_str().unwrap_or("-").to_owned();
            let number = |key: &str, scale: f64| {
                let number = swap[key].as_f64();
                number.map_or("-".to_owned(), |number| format!("{:.4}", number * scale))
            };
            table.push([
                word("slot"),
                word("from"),
                word("to"),
                number("requested_s", 1.0),
                number("flipped_s", 1.0),
                number("bump", 100.0),
                word("outcome"),
            ]);
        }
        table
    }

    fn audit(&self) -> Table {
        let mut table = Table::new(["topic", "seat", "samples", "first", "last", "gaps"]);
        for AuditRow { topic, seat, samples, first, last, gaps } in &self.audit {
            let numbers = [*samples, *first, *last, *gaps].map(|number| number.to_string());
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
        let mut document = document.verdict(self.passes(), &self.sentence);
        document = document.paragraph(&format!("From {}.", self.file));
        for section in SECTIONS {
            let (table, command) = self.table(section);
            let titled = document.heading(&capital(section)).table(&table);
            document = titled.paragraph(&format!("Again: {command}"));
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

/// A page for people of one report or several, with the same for machines in it.
#[must_use]
pub fn document(reports: &[Report]) -> String {
    let title = match reports {
        [one] => format!("morphquad report: {}", one.scenario),
        several => format!("morphquad report: {} flights", several.len()),
    };
    let mut document = Document::new(&title);
    if reports.len() > 1 {
        let passed = reports.iter().filter(|report| report.passes()).count();
        let text = format!("{passed} of {} flights pass.", reports.len());
        document = document.verdict(passed == reports.len(), &text);
    }
    for report in reports {
        if reports.len() > 1 {
            document = document.heading(&report.file);
        }
        document = report.part(document);
    }
    let told: Value = reports.iter().map(Report::to_json).collect();
    document.json("report", &told).to_html()
}

fn capital(word: &str) -> String {
    let (first, rest) = word.split_at(1);
    first.to_uppercase() + rest
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.sentence)?;
        for section in SECTIONS {
            let (table, command) = self.table(section);
            write!(f, "\n{} (again: {command})\n{table}", capital(section))?;
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
