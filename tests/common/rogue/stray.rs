//! A process that has not been given a seat.

use host::BuildError;
use runtime::ipc::{Bus, IpcSink, PortError, ServiceKind, StatePublisher};
use runtime::namespace::Membership;
use runtime::{Sink as _, StateSink as _};
use shared_types::{
    ClockMode, ClockRecord, Flag, Header, Hello, NO_SEAT, OwnerRecord, Progress, Registry,
    RegistryEntry, Role, Seat, Slot, WrenchCommand, topics,
};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// A number that no sum survives.
const FAR: u64 = u64::MAX / 2;

/// Publishes all that could take a flight over, for a minute or until it is killed. `usurps`: it first frees
/// what dead processes have left, as any client of the transport can.
pub(super) fn write_on(folder: &Path, usurps: bool) -> ExitCode {
    match write(folder, usurps) {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) => ExitCode::FAILURE,
    }
}

fn write(folder: &Path, usurps: bool) -> Result<(), BuildError> {
    let membership = Membership::join(folder)?;
    let bus = Bus::join(&membership.ipc_config(), "rogue")?;
    if usurps {
        bus.sweep_dead_processes(&mut || ());
    }
    let mut forger = Forger::open(&bus)?;
    for k in 0_u64..12_000 {
        forger.forge(k);
        #[expect(clippy::print_stdout, reason = "the test waits for it")]
        if k.is_multiple_of(100) {
            println!("it writes");
        }
        #[expect(
            clippy::disallowed_methods,
            reason = "it waits for no other process, which is what is tested"
        )]
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(())
}

/// The services on which one process publishes its state and progress, and its launcher the handover.
struct Post {
    seat: Seat,
    state: StatePublisher,
    handover: StatePublisher,
    progress: IpcSink<Progress>,
}

/// Writes on every service that a flight follows.
struct Forger {
    commands: IpcSink<WrenchCommand>,
    posts: Vec<Post>,
    clock: IpcSink<ClockRecord>,
    hello: IpcSink<Hello>,
    registry: IpcSink<Registry>,
    owners: Vec<(Role, IpcSink<OwnerRecord>)>,
    /// The line of the registry that it gives itself.
    line: RegistryEntry,
}

impl Forger {
    fn open(bus: &Bus) -> Result<Self, PortError> {
        let post = |seat| {
            Ok::<_, PortError>(Post {
                seat,
                state: StatePublisher::open(bus, ServiceKind::State(seat), 4096)?,
                handover: StatePublisher::open(bus, ServiceKind::Handover(seat), 4096)?,
                progress: bus.open_writer(ServiceKind::Progress(seat))?,
            })
        };
        // What a dead launcher alone held is gone once it has been swept.
        let seats = Role::STEPPING.into_iter().flat_map(Seat::all);
        let posts = seats.filter_map(|seat| post(seat).ok());
        let slots = Slot::ALL.map(|slot| (slot.role(), slot.spec().owner));
        let owners = slots.map(|(role, topic)| Ok((role, bus.writer(topic)?)));
        Ok(Self {
            commands: bus.writer(&topics::WRENCH_COMMAND)?,
            posts: posts.collect(),
            clock: bus.open_writer(ServiceKind::Clock)?,
            hello: bus.open_writer(ServiceKind::Hello)?,
            registry: bus.open_writer(ServiceKind::Registry)?,
            owners: owners.into_iter().collect::<Result<_, PortError>>()?,
            line: RegistryEntry {
                node: bus.identity(),
                role: Role::Attitude,
                period_ns: 2_000_000,
                present: Flag::Yes,
                ..RegistryEntry::default()
            },
        })
    }

    /// Full thrust upside down for all of a flight to come, in the name of every seat, and whatever would make it
    /// count.
    fn forge(&mut self, k: u64) {
        let mut registry = Registry { count: 1, ..Registry::default() };
        registry.entries[0] = self.line;
        self.registry.send(&registry);
        self.hello.send(&Hello { period_ns: 2_000_000, role: Role::Attitude, ..Hello::default() });
        self.clock.send(&ClockRecord {
            end_ns: 1,
            speed: 1.0,
            mode: ClockMode::Lockstep,
            started: Flag::Yes,
            may_leave: Flag::Yes,
            ..ClockRecord::default()
        });
        for (slot, owner) in &mut self.owners {
            owner.send(&OwnerRecord {
                header: Header { sequence: FAR + k, ..Header::default() },
                epoch: FAR + k,
                period_ns: [2_000_000; 4],
                owner: 3,
                fallback: NO_SEAT,
                slot: *slot,
                ..OwnerRecord::default()
            });
        }
        let release_ns = 50_000_000 * k;
        for Post { seat, state, handover, progress } in &mut self.posts {
            for generation in 0..2 {
                let header = Header {
                    sequence: FAR + k,
                    release_ns: FAR + release_ns,
                    seat: seat.index,
                    generation,
                    ..Header::default()
                };
                state.send(&header, &[0xff; 1000]);
                handover.send(&header, &[0xff; 1000]);
                progress.send(&Progress { mark_ns: FAR, generation, ..Progress::default() });
            }
        }
        for seat in 0..4 {
            self.commands.send(&WrenchCommand {
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
    }
}
