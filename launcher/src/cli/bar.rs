//! Progress on a terminal, and nothing elsewhere.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::{self, IsTerminal as _};

/// A bar over `length` things called `what`, with the time left.
pub(super) fn bar(length: usize, what: &str) -> ProgressBar {
    if !io::stderr().is_terminal() {
        // Still counts, and draws nothing.
        let hidden = indicatif::ProgressDrawTarget::hidden();
        return ProgressBar::with_draw_target(Some(length as u64), hidden);
    }
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what} {{elapsed}}, {{eta}} left");
    let style = ProgressStyle::with_template(&template);
    ProgressBar::new(length as u64)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// A sign that something is done whose length nobody knows.
pub(super) fn spinner(what: &'static str) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let spinner = ProgressBar::new_spinner().with_message(what);
    spinner.enable_steady_tick(core::time::Duration::from_millis(100));
    spinner
}
