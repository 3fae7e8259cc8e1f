//! A registry for benches that have no launcher.

use runtime::Sink as _;
use runtime::ipc::{Bus, IpcSink, PortError, ServiceKind, TopicFactory};
use shared_types::{Registry, Role};

/// Keeps the registry for as long as it is listened to.
pub(crate) type Held = (TopicFactory<Registry>, IpcSink<Registry>);

/// Enters this connection in the registry as `role`, so that readers accept its samples.
pub(crate) fn enrol(bus: &Bus, role: Role) -> Result<Held, PortError> {
    bus.lead()?;
    let factory = bus.create_service::<Registry>(ServiceKind::Registry, 2)?;
    let mut writer = bus.open_writer::<Registry>(ServiceKind::Registry)?;
    let mut registry = Registry { count: 1, ..Registry::default() };
    registry.entries[0].node = bus.identity();
    registry.entries[0].role = role;
    writer.send(&registry);
    Ok((factory, writer))
}
