//! The injector as a process: a script and orders in, the disturbance in effect out.

use crate::{Injector, InjectorConfig, InjectorError, InjectorMemory};
use runtime::{Service, inputs, outputs};
use shared_types::{Disturbance, DisturbanceOrder, topics};

inputs! {
    /// A script needs no inputs; this is what comes beside it.
    pub struct Inputs {
        /// Disturbances ordered in flight.
        order: DisturbanceOrder = topics::DISTURBANCE_ORDER,
    }
}

outputs! {
    /// What the injector writes.
    pub struct Outputs {
        /// Disturbance in effect until the next sample.
        disturbance: Disturbance = topics::DISTURBANCE,
    }
}

/// The injector between its ports.
#[derive(Debug)]
pub struct DisturbanceInjector {
    injector: Injector,
}

impl DisturbanceInjector {
    /// An injector at the start of its script.
    ///
    /// # Errors
    /// The script is impossible.
    pub fn new(config: &InjectorConfig, seed: u64) -> Result<Self, InjectorError> {
        Ok(Self { injector: Injector::new(config, seed)? })
    }
}

impl Service for DisturbanceInjector {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = InjectorMemory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        if let Some(order) = inputs.order.latest() {
            self.injector.follow(order);
        }
        let now = self.injector.step(now_ns);
        outputs.disturbance.write(Disturbance {
            wind_w_m_s: now.wind_w_m_s,
            force_w_n: now.force_w_n,
            torque_b_nm: now.torque_b_nm,
            body_rate_kick_b_rad_s: now.body_rate_kick_b_rad_s,
            payload_kg: now.payload_kg,
            rotor_efficiency: now.rotor_efficiency,
            ..Disturbance::default()
        });
    }

    fn memory(&self) -> InjectorMemory {
        self.injector.memory()
    }

    fn restore(&mut self, memory: &InjectorMemory) -> Result<(), String> {
        self.injector.restore(memory);
        Ok(())
    }

    fn reseed(&mut self, seed: u64) {
        self.injector.reseed(seed);
    }
}
