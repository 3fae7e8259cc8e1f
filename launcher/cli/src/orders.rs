//! `morphquad swap`, `rollback`, `retire`, `standby`, `stop`, `goto`, `morph` and `disturb`: orders to a
//! running flight.

use super::options::{
    DisturbArguments, Format, GotoArguments, MorphArguments, RetireArguments, RollbackArguments,
    RunChoice, StandbyArguments, StopArguments, SwapArguments,
};
use super::ps::Trouble;
use super::refusal::{Done, Failure};
use host::exit;
use protocol::control::client::Conversation;
use protocol::control::protocol::SwapRequest;
use protocol::control::{Reply, Request, runs};
use scenario::candidate::Candidate;
use scenario::orders::{Goto, Morph, Order};
use serde_json::json;
use shared_types::Slot;
use std::io::Write;
use std::path::Path;

/// Swaps; 0 when the rollback window is over, 1 if nothing came of it, 2 and 3 if it was refused.
pub(super) fn swap(arguments: &SwapArguments, out: &mut dyn Write) -> Done {
    let request = Request::Swap(SwapRequest {
        slot: arguments.slot.clone(),
        to: resolved(&arguments.slot, &arguments.to),
        config: arguments.config.as_deref().map(|path| absolute(path).into()),
        shadow_ns: nanoseconds(arguments.shadow),
        max_bump: arguments.max_bump,
        rollback_ns: nanoseconds(arguments.rollback),
        force: arguments.force,
        rehearse: arguments.rehearsal.choice(),
        dry_run: arguments.dry_run,
    });
    order(&arguments.run, &request, arguments.format, out)
}

/// Gives the slot back to its old owner, while that is still warm.
pub(super) fn roll_back(arguments: &RollbackArguments, out: &mut dyn Write) -> Done {
    let request = Request::Rollback { slot: arguments.slot.clone() };
    order(&arguments.run, &request, arguments.format, out)
}

/// Sends an instance away.
pub(super) fn retire(arguments: &RetireArguments, out: &mut dyn Write) -> Done {
    let request = Request::Retire { name: arguments.name.clone() };
    order(&arguments.run, &request, arguments.format, out)
}

/// Keeps an instance warm.
pub(super) fn stand_by(arguments: &StandbyArguments, out: &mut dyn Write) -> Done {
    let request = Request::Standby {
        slot: arguments.slot.clone(),
        name: resolved(&arguments.slot, &arguments.name),
        shadow_ns: nanoseconds(arguments.shadow),
        rehearse: arguments.rehearsal.choice(),
    };
    order(&arguments.run, &request, arguments.format, out)
}

/// Ends the flight in order.
pub(super) fn stop(arguments: &StopArguments, out: &mut dyn Write) -> Done {
    order(&arguments.run, &Request::Stop, arguments.format, out)
}

/// Sends the vehicle to a place.
pub(super) fn go_to(arguments: &GotoArguments, out: &mut dyn Write) -> Done {
    let &GotoArguments { x, y, z, yaw, ref run, format } = arguments;
    fly_otherwise(Order::Goto(Goto { position_w_m: [x, y, z], yaw_deg: yaw }), run, format, out)
}

/// Folds or spreads the arms.
pub(super) fn morph(arguments: &MorphArguments, out: &mut dyn Write) -> Done {
    let &MorphArguments { degrees, over, ref run, format } = arguments;
    let over_s = over.as_secs_f64();
    fly_otherwise(Order::Morph(Morph { angle_deg: degrees, over_s }), run, format, out)
}

/// Disturbs, or ends that.
pub(super) fn disturb(arguments: &DisturbArguments, out: &mut dyn Write) -> Done {
    let (order, target) = arguments.what.order();
    fly_otherwise(order, &target.run, target.format, out)
}

/// Sends an order to pilot or injector; what no flight could do is refused without asking one.
fn fly_otherwise(order: Order, run: &RunChoice, format: Format, out: &mut dyn Write) -> Done {
    if let Err(wrong) = order.check(-scenario::orders::REACH_M) {
        let trouble = Trouble::OutOfRange(wrong.sentence());
        let code = trouble.exit_code();
        return Err(Failure::report(trouble, code));
    }
    self::order(run, &Request::Order { order }, format, out)
}

/// Sends a request and shows what comes, line by line, until the last reply.
pub(super) fn order(
    run: &RunChoice,
    request: &Request,
    format: Format,
    out: &mut dyn Write,
) -> Done {
    let refuse = |trouble: Trouble| {
        let code = trouble.exit_code();
        Failure::report(trouble, code)
    };
    let found = runs::find(run.run.as_deref()).map_err(|error| refuse(error.into()))?;
    let asked = Conversation::ask(&found, request);
    let mut conversation = asked.map_err(|error| refuse(error.into()))?;
    loop {
        let reply = conversation.receive().map_err(|error| refuse(error.into()))?;
        let text = match &reply {
            Reply::Refused(refusal) => return Err(refuse(Trouble::Refused(refusal.clone()))),
            Reply::Status(_) => return Err(refuse(Trouble::Astray)),
            Reply::Progress(progress) => progress.text.clone(),
            Reply::Done(done) => done.text.clone(),
            Reply::Ordered(report) => report.sentence(),
        };
        match format {
            Format::Text => writeln!(out, "{text}")?,
            Format::Json => writeln!(out, "{}", json!(reply))?,
        }
        out.flush()?;
        if reply.is_last() {
            return Ok(exit::PASS);
        }
        // It is under way: from here on the flight sets the pace.
        conversation.be_patient();
    }
}

/// A path, or a command on this terminal's search path, as the launcher can find it; a name that is
/// none of them is for the launcher to know.
fn resolved(slot: &str, to: &str) -> String {
    if to.contains('/') {
        return absolute(Path::new(to));
    }
    match Slot::named(slot).map(|slot| Candidate::find(slot, to)) {
        Some(Ok(Candidate::Executable(path))) => path.display().to_string(),
        _ => to.to_owned(),
    }
}

fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()).display().to_string()
}

fn nanoseconds(duration: core::time::Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
