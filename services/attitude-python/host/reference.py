"""Where a reference has the vehicle be."""

# Its acceleration is taken so far ahead: an attitude loop answers that much later [ns].
LEAD_NS = 50_000_000
# Without a new reference for so long the vehicle lands [s], and how fast [m/s].
HOVER_S, LANDING_M_S = 2.0, 0.5


def motion_at(reference, t_ns):
    """Position, velocity and heading at an instant, the acceleration `LEAD_NS` later, and whether it is at its end. It has
    constant acceleration between its points, and rests at the last one."""
    age_ns, spacing_ns = max(0, t_ns - reference.header.valid_ns), max(1, reference.spacing_ns)
    end, spacing_s = min(max(1, reference.count), len(reference.points)) - 1, spacing_ns * 1e-9
    index = age_ns // spacing_ns
    point = reference.points[min(index, end)]
    if index >= end:
        still = (0.0, 0.0, 0.0)
        return tuple(point.position_w_m), still, still, point.yaw_rad, True
    since_s = (age_ns % spacing_ns) * 1e-9

    def slope(index):
        ends = (reference.points[min(one, end)] for one in (index, index + 1))
        before, after = (one.velocity_w_m_s for one in ends)
        return tuple((b - a) / spacing_s for a, b in zip(before, after))

    now, velocity = slope(index), tuple(point.velocity_w_m_s)
    position = tuple(
        p + (v + 0.5 * a * since_s) * since_s for p, v, a in zip(point.position_w_m, velocity, now)
    )
    velocity = tuple(v + a * since_s for v, a in zip(velocity, now))
    ahead = slope((age_ns + LEAD_NS) // spacing_ns)
    return position, velocity, ahead, point.yaw_rad, False


def landing_at(reference, t_ns, hover_s=HOVER_S):
    """Position, velocity, acceleration and heading as in `motion_at`, and the way down to the ground once the reference is
    older than `hover_s`, first along what is left of it."""
    position, velocity, ahead, yaw_rad, rests = motion_at(reference, t_ns)
    age_s = max(0, t_ns - reference.header.valid_ns) * 1e-9
    descent_m = LANDING_M_S * max(0.0, age_s - hover_s)
    if descent_m > 0.0:
        x, y, z = position
        height_m = max(min(z, 0.0), z - descent_m)
        sinks = not rests or height_m > 0.0
        position = (x, y, height_m)
        velocity = (*velocity[:2], velocity[2] - LANDING_M_S) if sinks else velocity
    return position, velocity, ahead, yaw_rad
