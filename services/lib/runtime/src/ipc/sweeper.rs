//! What dead processes have left in the transport.

use super::{Bus, Ipc};
use iceoryx2::prelude::{CallbackProgression, Config, Node as IpcNode, NodeState};

/// Frees what dead processes of a run leave behind. Needs no connection, so that any thread can do it.
#[derive(Debug, Clone)]
pub struct Sweeper {
    config: Config,
}

impl Sweeper {
    /// Frees it. `drain` takes what they have sent, once it is known which they are: of one that dies meanwhile nothing is
    /// freed before the next sweep.
    pub fn sweep(&self, drain: &mut dyn FnMut()) {
        let mut dead = Vec::new();
        let look = |state| {
            if let NodeState::Dead(node) = state {
                dead.push(node);
            }
            CallbackProgression::Continue
        };
        // Nodes behind one that cannot be looked at are found by the next sweep.
        let _ = IpcNode::<Ipc>::list(&self.config, look);
        drain();
        for node in dead {
            // Another process may be removing the same one.
            let _ = node.try_remove_stale_resources();
        }
    }
}

impl Bus {
    /// As [`Sweeper::sweep`]; only the launcher does this.
    pub fn sweep_dead_processes(&self, drain: &mut dyn FnMut()) {
        self.sweeper().sweep(drain);
    }

    /// What frees what dead processes of this run leave behind.
    #[must_use]
    pub fn sweeper(&self) -> Sweeper {
        Sweeper { config: self.node().config().clone() }
    }
}
