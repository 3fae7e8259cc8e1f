//! Progress on a terminal, and nothing elsewhere.

use core::time::Duration;
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

/// A sign that work of unknown length is under way; it goes when dropped.
#[derive(Debug)]
pub(super) struct Busy(ProgressBar);

/// Shows what is being done, and for how long already.
pub(super) fn busy(what: &str) -> Busy {
    if !io::stderr().is_terminal() {
        return Busy(ProgressBar::hidden());
    }
    let style = ProgressStyle::with_template("{spinner} {msg} {elapsed}");
    let bar = ProgressBar::new_spinner()
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        .with_message(what.to_owned());
    bar.enable_steady_tick(Duration::from_millis(100));
    Busy(bar)
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
