//! What this user may ask for, found out by asking for it as a flight does.

use super::Finding;
use host::realtime::may_lock_memory;
use host::tasks::Tasks;
use runtime::priority::Schedule;
use rustix::process::{PidfdFlags, Resource, getpid, getrlimit, pidfd_open};
use scenario::{Scenario, needs};
use shared_types::Role;

/// Priority of the fastest loop of a flight as shipped, if the scenario sets none.
const USUAL_PRIORITY: u8 = 13;

pub(super) fn checks() -> Vec<Finding> {
    vec![fifo(), deadline(), memory_lock(), open_files(), processes(), pidfd(), stack()]
}

/// Highest priority that the loops of a shipped flight ask for.
fn highest_priority() -> u8 {
    let flight = Scenario::load("figure8-morph", &[scenario::Override::clock("realtime")])
        .ok()
        .and_then(|scenario| scenario.flight().ok());
    let setups = flight.iter().flat_map(|flight| Role::STEPPING.map(|role| flight.setup(role)));
    let priorities = setups.flatten().filter_map(|setup| match setup.schedule {
        Some(Schedule::Fifo(priority)) => Some(priority),
        _ => None,
    });
    priorities.max().unwrap_or(USUAL_PRIORITY)
}

fn fifo() -> Finding {
    let (name, priority) = ("fifo", highest_priority());
    if Schedule::Fifo(priority).is_allowed() {
        return Finding::ok(name, format!("SCHED_FIFO {priority} is granted"));
    }
    let remedy = format!(
        "`ulimit -r {priority}` after raising rtprio in /etc/security/limits.conf, or `setcap cap_sys_nice,cap_ipc_lock+ep` on the executable"
    );
    Finding::warn(name, "SCHED_FIFO is not granted: other programs go first", remedy)
}

fn deadline() -> Finding {
    let name = "deadline";
    let schedule = Schedule::Deadline { budget_ns: 250_000, period_ns: 1_000_000 };
    if schedule.is_allowed() {
        return Finding::ok(name, "SCHED_DEADLINE is granted");
    }
    let remedy = "give cap_sys_nice; only scenarios with realtime.policy = \"deadline\" need it";
    Finding::warn(name, "SCHED_DEADLINE is not granted", remedy)
}

fn memory_lock() -> Finding {
    let found = match getrlimit(Resource::Memlock).current {
        _ if may_lock_memory() => "all of it may be locked".to_owned(),
        Some(bytes) => format!("{} kB may be locked", bytes >> 10),
        None => "no limit".to_owned(),
    };
    let remedy = "`ulimit -l unlimited` after raising memlock in /etc/security/limits.conf";
    Finding::warn_if(!may_lock_memory(), "memory lock", found, remedy)
}

fn open_files() -> Finding {
    let name = "open files";
    let limit = getrlimit(Resource::Nofile);
    // A launcher raises the one to the other.
    let most = limit.maximum.unwrap_or(u64::MAX);
    let found = format!("{} of at most {}", limit_text(limit.current), limit_text(limit.maximum));
    let needed = needs::DESCRIPTORS;
    if most < needed {
        let remedy = format!(
            "raise nofile in /etc/security/limits.conf to {needed} or more, or `ulimit -Hn {needed}` as root"
        );
        return Finding::fail(name, found, remedy);
    }
    Finding::ok(name, found)
}

fn processes() -> Finding {
    let name = "processes";
    let Some(tasks) = Tasks::here() else {
        return Finding::ok(name, "as many as a flight needs");
    };
    let found = tasks.to_string();
    if tasks.left() >= needs::TASKS {
        return Finding::ok(name, found);
    }
    let remedy = format!("{}: a flight needs {} more", tasks.remedy(needs::TASKS), needs::TASKS);
    Finding::fail(name, found, remedy)
}

fn stack() -> Finding {
    let limit = getrlimit(Resource::Stack);
    let small = limit.current.is_some_and(|current| current < 2 << 20);
    let found = limit.current.map_or("no limit".to_owned(), |bytes| format!("{} kB", bytes >> 10));
    if small {
        Finding::fail("stack", found, "`ulimit -s 8192`")
    } else {
        Finding::ok("stack", found)
    }
}

fn pidfd() -> Finding {
    match pidfd_open(getpid(), PidfdFlags::empty()) {
        Ok(_) => Finding::ok("pidfd", "processes can watch their launcher"),
        Err(error) => {
            let remedy = "use Linux 5.3 or later, and a sandbox that allows pidfd_open";
            Finding::fail("pidfd", format!("pidfd_open: {error}"), remedy)
        }
    }
}

fn limit_text(limit: Option<u64>) -> String {
    limit.map_or("unlimited".to_owned(), |limit| limit.to_string())
}
