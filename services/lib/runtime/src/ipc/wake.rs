//! Waking a process that waits for its inputs.
//!
//! A wake-up carries no information: the woken process re-reads marks and inputs. Waits always
//! have a limit, after which shared memory is read again; a lost wake-up therefore costs time and
//! never a sample.

use super::{Bus, Ipc, PortError, ServiceKind, service_name};
use core::time::Duration;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::service::port_factory::event::PortFactory;
use shared_types::Role;

impl Bus {
    /// Creates the wake service of a role (launcher only).
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_wake_service(&self, role: Role) -> Result<PortFactory<Ipc>, PortError> {
        let service = ServiceKind::Wake(role).name();
        self.node
            .service_builder(&service_name(&service)?)
            .event()
            .max_notifiers(16)
            .max_listeners(4)
            .max_nodes(super::MAX_NODES)
            .create()
            .map_err(PortError::transport(&service, "create the service"))
    }

    fn open_wake_service(&self, role: Role) -> Result<PortFactory<Ipc>, PortError> {
        let service = ServiceKind::Wake(role).name();
        self.node
            .service_builder(&service_name(&service)?)
            .event()
            .open()
            .map_err(PortError::transport(&service, "open the service"))
    }
}

/// The waiting end.
#[derive(Debug)]
pub struct WakeListener {
    listener: Listener<Ipc>,
}

impl WakeListener {
    /// Opens the wake service of one's own role.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, role: Role) -> Result<Self, PortError> {
        let listener = bus
            .open_wake_service(role)?
            .listener_builder()
            .create()
            .map_err(PortError::transport(&ServiceKind::Wake(role).name(), "listen"))?;
        Ok(Self { listener })
    }

    /// Waits for a wake-up; true if one came before the limit.
    #[must_use]
    pub fn wait(&self, limit: Duration) -> bool {
        // A signal interrupts the wait; the caller looks at its flags either way.
        self.listener.timed_wait(|_| {}, limit).is_ok_and(|woken| woken > 0)
    }
}

/// The waking end.
#[derive(Debug)]
pub struct WakeNotifier {
    notifier: Notifier<Ipc>,
}

impl WakeNotifier {
    /// Opens the wake service of another role.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, role: Role) -> Result<Self, PortError> {
        let notifier = bus
            .open_wake_service(role)?
            .notifier_builder()
            .create()
            .map_err(PortError::transport(&ServiceKind::Wake(role).name(), "notify"))?;
        Ok(Self { notifier })
    }

    /// Wakes whoever waits; nobody waiting is fine.
    pub fn wake(&self) {
        let _ = self.notifier.notify();
    }
}
