//! Every section of a scenario, once: the type of a whole scenario, its reader and the list of its keys are made of this.

/// Hands the sections to a macro in the order told, each as its name, how it is read, and its type: `section` is a table,
/// `list` several of them under one name, and the others have readers of their own.
macro_rules! with_sections {
    ($with:ident) => {
        $with! {
            scenario section crate::settings::ScenarioSettings,
            vehicle section crate::settings::VehicleSettings,
            start section crate::settings::StartSettings,
            pilot pilot ::pilot::settings::Settings,
            plant section ::plant::settings::Settings,
            estimator section ::estimator::settings::Settings,
            position_mpc section ::position_mpc::settings::Settings,
            attitude_mpc section ::attitude_mpc::settings::Settings,
            position_pid section ::position_pid::settings::Settings,
            attitude_lqr section ::attitude_lqr::settings::Settings,
            attitude_pid section ::attitude_pid::settings::Settings,
            controller section crate::settings::ControllerSettings,
            disturbance_injector injector ::disturbance_injector::settings::Settings,
            monitor section ::monitor::settings::Settings,
            latency section crate::settings::LatencySettings,
            realtime section crate::settings::RealtimeSettings,
            launcher section crate::settings::LauncherSettings,
            rehearsal section crate::settings::RehearsalSettings,
            verdict section crate::settings::VerdictSettings,
            swap list Vec<crate::settings::SwapSettings>,
            standby list Vec<crate::settings::StandbySettings>,
            fault list Vec<crate::settings::FaultSettings>,
            order list Vec<crate::settings::OrderSettings>,
        }
    };
}

/// Hands the kinds of events of the disturbance injector to a macro: the word for `kind`, and the variant and type.
macro_rules! with_events {
    ($with:ident) => {
        $with! {
            constant Constant, step Step, pulse Pulse, sine Sine, ramp Ramp, rd Rd, kick Kick, wind Wind,
            payload Payload, rotor_efficiency RotorEfficiency,
        }
    };
}
