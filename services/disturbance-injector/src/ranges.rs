//! Checks that a derive macro cannot express.

/// Accepts finite numbers; a range alone would let NaN pass.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that the validator calls")]
pub(crate) fn finite(value: &f64, _context: &()) -> garde::Result {
    if value.is_finite() {
        Ok(())
    } else {
        Err(garde::Error::new(format!("{value} is not a number")))
    }
}

/// Accepts a finite instant after `at_s`.
pub(crate) fn later_than(at_s: f64) -> impl Fn(&f64, &()) -> garde::Result {
    move |until, ()| {
        if *until > at_s && until.is_finite() {
            Ok(())
        } else {
            Err(garde::Error::new(format!("{until} does not lie after at_s = {at_s}")))
        }
    }
}

/// Accepts no instant, or one as in [`later_than`].
pub(crate) fn after(at_s: f64) -> impl Fn(&Option<f64>, &()) -> garde::Result {
    move |until, context| until.as_ref().map_or(Ok(()), |until| later_than(at_s)(until, context))
}
