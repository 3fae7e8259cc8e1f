//! Why a port cannot be had.

use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why a port cannot be had.
#[derive(Debug, Error)]
pub enum PortError {
    /// Two builds disagree about a type.
    #[error(
        "service {service}: this executable lays out {type_name} as {ours}, the run as {theirs}: rebuild both from the same source"
    )]
    Layout {
        /// Service name.
        service: String,
        /// Sample type.
        type_name: &'static str,
        /// Our layout hash.
        ours: String,
        /// The run's layout hash.
        theirs: String,
    },
    /// The run cannot be led.
    #[error("cannot name in {} the process that leads the run: {source}", folder.display())]
    Lead {
        /// The run's folder.
        folder: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The services of the run cannot be linked a second time.
    #[error("cannot link the services of the run in {}: {source}", folder.display())]
    Spare {
        /// The run's folder.
        folder: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// A service has as many readers or writers as it admits, those of dead processes among them until they are freed.
    #[error("service {service}: cannot {action}: it admits no more")]
    Full {
        /// Service name.
        service: String,
        /// What was tried.
        action: &'static str,
    },
    /// The transport refused.
    #[error("service {service}: cannot {action}: {reason}")]
    Transport {
        /// Service name.
        service: String,
        /// What was tried.
        action: &'static str,
        /// Why it failed.
        reason: String,
    },
}

impl PortError {
    pub(super) fn transport<E: core::fmt::Debug>(
        service: &str,
        action: &'static str,
    ) -> impl FnOnce(E) -> Self + use<E> {
        let service = service.to_owned();
        move |error| Self::Transport { service, action, reason: format!("{error:?}") }
    }

    pub(super) fn no_reader(service: &str, error: SubscriberCreateError) -> Self {
        let action = "create a reader";
        match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                Self::Full { service: service.to_owned(), action }
            }
            error => Self::transport(service, action)(error),
        }
    }

    pub(super) fn no_writer(service: &str, error: PublisherCreateError) -> Self {
        let action = "create a writer";
        match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                Self::Full { service: service.to_owned(), action }
            }
            error => Self::transport(service, action)(error),
        }
    }
}
