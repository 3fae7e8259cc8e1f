//! What is wrong with a scenario, where, and what to do about it.

use core::fmt;
use miette::{Diagnostic, LabeledSpan, NamedSource, Severity, SourceCode};

/// Key, what is wrong with it, and what to do: a problem before its place is looked up.
pub type Complaint = (String, String, String);

/// One thing that is wrong, or doubtful, at one place.
#[derive(Debug, Clone)]
pub struct Problem(Box<Facts>);

#[derive(Debug, Clone)]
struct Facts {
    key: String,
    what: String,
    remedy: String,
    place: Option<Place>,
    severity: Severity,
    malformed: bool,
}

/// Where in which text.
#[derive(Debug, Clone)]
pub struct Place {
    pub source: NamedSource<String>,
    pub span: core::ops::Range<usize>,
}

impl Problem {
    pub fn new(
        key: impl Into<String>,
        what: impl Into<String>,
        remedy: impl Into<String>,
        place: Option<Place>,
    ) -> Self {
        let (key, what, remedy) = (key.into(), what.into(), remedy.into());
        let severity = Severity::Error;
        Self(Box::new(Facts { key, what, remedy, place, severity, malformed: false }))
    }

    /// The same about how the text is written, not about how much a value is.
    #[must_use]
    pub fn into_malformed(mut self) -> Self {
        self.0.malformed = true;
        self
    }

    #[must_use]
    pub fn into_warning(mut self) -> Self {
        self.0.severity = Severity::Warning;
        self
    }

    /// Dotted key, flag or name that the problem is about.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.0.key
    }

    /// Name of the file, or `command line`; `None` if no text could be read at all.
    #[must_use]
    pub fn file(&self) -> Option<&str> {
        self.0.place.as_ref().map(|place| place.source.name())
    }

    /// Line, counted from 1.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        let place = self.0.place.as_ref()?;
        let before = place.source.inner().get(..place.span.start)?;
        Some(before.matches('\n').count() + 1)
    }

    /// True if the key does not exist, or takes no value of this kind.
    #[must_use]
    pub fn is_malformed(&self) -> bool {
        self.0.malformed
    }

    /// What to do about it.
    #[must_use]
    pub fn remedy(&self) -> &str {
        &self.0.remedy
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.key.is_empty() {
            write!(f, "{}", self.0.what)
        } else {
            write!(f, "{}: {}", self.0.key, self.0.what)
        }
    }
}

impl core::error::Error for Problem {}

impl Diagnostic for Problem {
    fn severity(&self) -> Option<Severity> {
        Some(self.0.severity)
    }

    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(&self.0.remedy))
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.0.place.as_ref().map(|place| &place.source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.0.place.as_ref()?.span.clone();
        Some(Box::new(core::iter::once(LabeledSpan::underline(span))))
    }
}

/// Everything that keeps a scenario from flying.
#[derive(Debug, Clone)]
pub struct ScenarioError {
    first: Problem,
    others: Vec<Problem>,
}

impl ScenarioError {
    /// `None` if nothing is wrong.
    #[must_use]
    pub fn from_problems(problems: Vec<Problem>) -> Option<Self> {
        let mut problems = problems.into_iter();
        problems.next().map(|first| Self { first, others: problems.collect() })
    }

    /// Each problem, in the order of the sections.
    pub fn problems(&self) -> impl Iterator<Item = &Problem> {
        core::iter::once(&self.first).chain(&self.others)
    }
}

impl From<Problem> for ScenarioError {
    fn from(first: Problem) -> Self {
        Self { first, others: Vec::new() }
    }
}

impl fmt::Display for ScenarioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.first.fmt(f)
    }
}

impl core::error::Error for ScenarioError {}

impl Diagnostic for ScenarioError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.first.help()
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.first.source_code()
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        self.first.labels()
    }

    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn Diagnostic> + 'a>> {
        if self.others.is_empty() {
            return None;
        }
        Some(Box::new(self.others.iter().map(|problem| problem as &dyn Diagnostic)))
    }
}
