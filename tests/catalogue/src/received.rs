//! What a controller receives whose fault lies in that.

use controller::attitude::Inputs as AttitudeInputs;
use controller::position::Inputs as PositionInputs;
use runtime::Input;
use shared_types::{Sample, StateEstimate};
use std::any::Any;

/// What of a step's inputs is passed on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Received {
    /// Trips of the other slot's owner.
    pub trips: bool,
    /// New references.
    pub references: bool,
    /// What is added to how far to the east the vehicle is \[m\].
    pub east_m: f64,
}

/// Passes on what a controller has received in a step.
pub(crate) fn pass_on(now_ns: u64, received: Received, from: &dyn Any, to: &mut dyn Any) {
    if let (Some(from), Some(to)) =
        (from.downcast_ref::<AttitudeInputs>(), to.downcast_mut::<AttitudeInputs>())
    {
        pass_estimate(now_ns, received, &from.state_estimate, &mut to.state_estimate);
        pass(now_ns, &from.attitude_setpoint, &mut to.attitude_setpoint);
        pass(now_ns, &from.applied_command, &mut to.applied_command);
        pass(now_ns, &from.morph_command, &mut to.morph_command);
        pass(now_ns, &from.position_owner, &mut to.position_owner);
        if received.references {
            pass(now_ns, &from.reference, &mut to.reference);
        }
        if received.trips {
            pass(now_ns, &from.trip, &mut to.trip);
        }
    }
    if let (Some(from), Some(to)) =
        (from.downcast_ref::<PositionInputs>(), to.downcast_mut::<PositionInputs>())
    {
        pass_estimate(now_ns, received, &from.state_estimate, &mut to.state_estimate);
        pass(now_ns, &from.applied_setpoint, &mut to.applied_setpoint);
        pass(now_ns, &from.applied_command, &mut to.applied_command);
        pass(now_ns, &from.morph_command, &mut to.morph_command);
        pass(now_ns, &from.attitude_owner, &mut to.attitude_owner);
        if received.references {
            pass(now_ns, &from.reference, &mut to.reference);
        }
    }
}

fn pass<T: Sample>(now_ns: u64, from: &Input<T>, to: &mut Input<T>) {
    pass_altered(now_ns, from, to, |sample| sample);
}

fn pass_estimate(
    now_ns: u64,
    received: Received,
    from: &Input<StateEstimate>,
    to: &mut Input<StateEstimate>,
) {
    pass_altered(now_ns, from, to, |mut estimate| {
        estimate.position_w_m[0] += received.east_m;
        estimate
    });
}

fn pass_altered<T: Sample>(
    now_ns: u64,
    from: &Input<T>,
    to: &mut Input<T>,
    alter: impl Fn(T) -> T,
) {
    if let (None, Some(before)) = (to.latest(), from.before_fresh()) {
        to.offer(alter(*before));
        to.accept(now_ns, None);
    }
    from.fresh().iter().for_each(|sample| to.offer(alter(*sample)));
    to.accept(now_ns, None);
}
