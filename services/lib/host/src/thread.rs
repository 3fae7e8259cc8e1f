//! Name and processor of a loop's thread.

use rustix::thread::{CpuSet, sched_setaffinity, set_name};
use std::ffi::CString;

/// Characters in the name of a thread, as the system keeps it.
const MAX_NAME_LEN: usize = 15;

/// Name in `ps -L`, `top -H` and debuggers.
pub fn name_thread(name: &str) {
    if let Ok(name) = CString::new(short(name)) {
        // A missing name disturbs nothing.
        let _ = set_name(&name);
    }
}

/// As many parts of a name, between hyphens, as fit.
fn short(name: &str) -> &str {
    let fits = name.floor_char_boundary(MAX_NAME_LEN);
    if fits == name.len() {
        return name;
    }
    let last_hyphen = name[..fits].rfind('-').filter(|at| *at > 0);
    &name[..last_hyphen.unwrap_or(fits)]
}

/// Keeps the calling thread on one processor; without permission it stays where it is.
pub fn stay_on(cpu: usize) {
    let mut set = CpuSet::new();
    set.set(cpu);
    let _ = sched_setaffinity(None, &set);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_name_is_cut_after_a_word() {
        assert_eq!(short("attitude-mpc"), "attitude-mpc");
        assert_eq!(short("disturbance-injector"), "disturbance");
        assert_eq!(short("unhyphenatedcontroller"), "unhyphenatedcon");
        assert_eq!(short("-unhyphenatedcontroller"), "-unhyphenatedco");
        assert_eq!(short("größtmöglicher"), "größtmöglich");
    }
}
