//! The result of the examination, for people and machines.

use super::{Finding, Verdict};
use core::fmt;
use serde_json::{Value, json};

/// Everything that was found.
#[derive(Debug, Clone)]
pub struct Report {
    /// In the order of the checks.
    pub findings: Vec<Finding>,
    /// What was mended.
    pub fixed: Vec<String>,
}

impl Report {
    /// How many findings have a verdict.
    #[must_use]
    pub fn count(&self, verdict: Verdict) -> usize {
        self.findings.iter().filter(|finding| finding.verdict == verdict).count()
    }

    /// True if nothing fails.
    #[must_use]
    pub fn is_fit(&self) -> bool {
        self.count(Verdict::Fail) == 0
    }

    /// For machines.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let check = |finding: &Finding| {
            let Finding { check, verdict, found, remedy } = finding;
            json!({ "check": check, "verdict": verdict.label(), "found": found, "remedy": remedy })
        };
        json!({
            "fit": self.is_fit(),
            "ok": self.count(Verdict::Ok),
            "warn": self.count(Verdict::Warn),
            "fail": self.count(Verdict::Fail),
            "checks": self.findings.iter().map(check).collect::<Vec<_>>(),
            "fixed": self.fixed,
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for fixed in &self.fixed {
            writeln!(f, "FIXED {fixed}")?;
        }
        for Finding { check, verdict, found, remedy } in &self.findings {
            write!(f, "{verdict:<5} {check:<15} {found}")?;
            if remedy.is_empty() { writeln!(f)? } else { writeln!(f, " -> {remedy}")? }
        }
        let [ok, warn, fail] = [Verdict::Ok, Verdict::Warn, Verdict::Fail].map(|v| self.count(v));
        let fit = if self.is_fit() { "fit to fly" } else { "not fit: mend what fails" };
        writeln!(f, "\n{ok} ok, {warn} to improve, {fail} failed: {fit}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_failure_makes_it_unfit_and_warnings_do_not() {
        let mut report =
            Report { findings: vec![Finding::warn("a", "found", "do")], fixed: Vec::new() };
        assert!(report.is_fit());
        report.findings.push(Finding::fail("b", "broken", "mend"));
        assert!(!report.is_fit());
        let json = report.to_json();
        assert_eq!((json["fit"].as_bool(), json["warn"].as_u64()), (Some(false), Some(1)));
        assert!(report.to_string().contains("FAIL  b               broken -> mend\n"), "{report}");
    }
}
