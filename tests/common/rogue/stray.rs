//! A process that nobody has given a seat.

use host::BuildError;
use runtime::Sink as _;
use runtime::ipc::Bus;
use runtime::namespace::Membership;
use shared_types::{Header, WrenchCommand, topics};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Publishes full thrust upside down for all of a flight to come, in the name of every seat, for a minute or until it
/// is killed.
pub(super) fn write_on(folder: &Path) -> ExitCode {
    match write(folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) => ExitCode::FAILURE,
    }
}

fn write(folder: &Path) -> Result<(), BuildError> {
    let membership = Membership::join(folder)?;
    let bus = Bus::join(&membership.ipc_config(), "rogue")?;
    let mut port = bus.writer(&topics::WRENCH_COMMAND)?;
    for k in 0_u64..12_000 {
        for seat in 0..4 {
            let release_ns = 50_000_000 * k;
            port.send(&WrenchCommand {
                header: Header {
                    sequence: 1_000_000 + k,
                    release_ns,
                    valid_ns: release_ns + 1_000_000,
                    cause_sequence: 1,
                    seat,
                    ..Header::default()
                },
                thrust_n: 1.0,
                torque_b_nm: [0.02, -0.02, 0.01],
                validity_ns: 60_000_000_000,
            });
        }
        #[expect(
            clippy::disallowed_methods,
            reason = "it waits for nobody, which is what is tested"
        )]
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(())
}
