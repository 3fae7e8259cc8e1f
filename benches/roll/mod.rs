//! A roll for benches that have no launcher.

use runtime::Sink as _;
use runtime::ipc::{Bus, IpcSink, PortError, ServiceKind, TopicFactory};
use shared_types::{Role, Roll};

/// Keeps the roll for as long as it is listened to.
pub(crate) type Held = (TopicFactory<Roll>, IpcSink<Roll>);

/// Puts this connection on the roll as `role`, so that its samples are heard.
pub(crate) fn enrol(bus: &Bus, role: Role) -> Result<Held, PortError> {
    bus.lead()?;
    let factory = bus.create_service::<Roll>(ServiceKind::Roll, 2)?;
    let mut writer = bus.open_writer::<Roll>(ServiceKind::Roll)?;
    let mut roll = Roll { count: 1, ..Roll::default() };
    roll.entries[0].node = bus.identity();
    roll.entries[0].role = role;
    writer.send(&roll);
    Ok((factory, writer))
}
