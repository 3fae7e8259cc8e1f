//! Every section of a scenario and every built-in controller, once: the type of a whole scenario, its reader, the list of
//! its keys, the loops by name, their checks and what builds them are made of this.

/// Hands the built-in controllers to a macro, after what is given with its name: each as its name, its section, and the type
/// of that. The first of a slot fills it unless another one is asked for.
#[macro_export]
macro_rules! with_controllers {
    ($with:ident [$($given:tt)*]) => {
        $with! { [$($given)*]
            "position-mpc" position_mpc ::position_mpc::settings::Settings,
            "position-pid" position_pid ::position_pid::settings::Settings,
            "attitude-mpc" attitude_mpc ::attitude_mpc::settings::Settings,
            "attitude-lqr" attitude_lqr ::attitude_lqr::settings::Settings,
            "attitude-pid" attitude_pid ::attitude_pid::settings::Settings,
        }
    };
}

/// Hands the sections to a macro in the order below, each as its name, how it is read, and its type: `section` is a
/// table, `list` several of them under one name, and the others have readers of their own.
macro_rules! with_sections {
    ($with:ident) => {
        with_controllers! { among_sections [$with] }
    };
}

macro_rules! among_sections {
    ([$with:ident] $($name:literal $section:ident $settings:ty,)*) => {
        $with! {
            scenario section crate::settings::ScenarioSettings,
            vehicle section crate::settings::VehicleSettings,
            start section crate::settings::StartSettings,
            pilot pilot ::pilot::settings::Settings,
            plant section ::plant::settings::Settings,
            estimator section ::estimator::settings::Settings,
            $($section section $settings,)*
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
            timing list Vec<crate::settings::TimingSettings>,
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
