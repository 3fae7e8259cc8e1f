//! An entry of the catalogue as a swap candidate: `morphquad swap attitude --to PATH --config ENTRY.toml`.

use catalogue::{Builder, Entry};
use clap::Parser;
use host::{
    Config, HostError, Joined, LAYOUT_ARGUMENT, PlaceArguments, conclude, exit, layout_hash,
};
use runtime::Ending;
use scenario::Scenario;
use shared_types::Slot;
use std::io::Write as _;
use std::process::ExitCode;
use vehicle::MorphAngle;

/// Largest command of roll and pitch of a position controller with a law that does not limit them \[rad\].
const TILT_RAD: f64 = 0.35;

/// A bad controller for a run of morphquad, which starts it.
#[derive(Debug, Parser)]
struct Arguments {
    /// Slot to fly
    #[arg(long, value_name = "attitude|position")]
    slot: String,
    #[command(flatten)]
    place: PlaceArguments,
}

fn fly(arguments: Arguments) -> Result<Ending, HostError> {
    let refuse = |why: String| HostError::Build(why.into());
    let slot = Slot::named(&arguments.slot)
        .ok_or_else(|| refuse(format!("there is no slot {}", arguments.slot)))?;
    let entry: Entry = Config::new(arguments.place.config.clone()).read()?;
    let file = arguments.place.run.join("scenario.toml");
    let scenario = Scenario::load(&file.to_string_lossy(), &[])
        .map_err(|error| HostError::Build(error.into()))?;
    let joined = Joined::join("catalogue", slot.role(), arguments.place)?;
    let largest = match slot {
        Slot::Attitude => joined.flight().vehicle().largest_wrench(MorphAngle::MIN),
        Slot::Position => {
            let tilt_rad = scenario.position_law().map_or(TILT_RAD, |law| law.tilt_max_rad);
            let weight_n = joined.flight().vehicle().weight_n();
            [weight_n, tilt_rad, tilt_rad, tilt_rad]
        }
    };
    let rate_hz = joined.flight().rate_hz(slot.role());
    let rate_hz = rate_hz.ok_or_else(|| refuse("this flight has no such loop".to_owned()))?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
    let period_ns = (1e9 / rate_hz) as u64;
    let first = scenario::services::names_for(slot.role()).next().unwrap_or_default();
    let law = entry.law.clone().unwrap_or_else(|| first.to_owned());
    let builder = Builder { joined, entry, largest, period_ns };
    components::visit_service(&law, &scenario, builder).map_err(HostError::Build)?
}

fn main() -> ExitCode {
    if std::env::args_os().nth(1).is_some_and(|argument| argument == LAYOUT_ARGUMENT) {
        // The reader of the pipe may have exited, which is no error here.
        let _ = writeln!(std::io::stdout(), "{:016x}", layout_hash());
        return ExitCode::from(exit::PASS);
    }
    ExitCode::from(conclude("catalogue", fly(Arguments::parse())))
}
