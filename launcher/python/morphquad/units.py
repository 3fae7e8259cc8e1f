"""Units, which the names of fields end with."""

# How a unit is written, by the end of a name; longer ends come first.
UNITS = {
    "kg_m2": "kg m²",
    "rad_s2": "rad/s²",
    "rad_s": "rad/s",
    "rad2": "rad²",
    "m_s2": "m/s²",
    "m2": "m²",
    "m_s": "m/s",
    "n_m": "N m",
    "nm": "N m",
    "deg": "deg",
    "rad": "rad",
    "kg": "kg",
    "hz": "Hz",
    "ns": "ns",
    "s": "s",
    "m": "m",
    "n": "N",
}


def unit_of(column: str) -> str | None:
    """Unit of a column such as `velocity_w_m_s[2]`; None for a number, a flag or a name."""
    name = column.rsplit(".", 1)[-1].split("[")[0]
    if "_per_" in name:
        return None
    return next((unit for end, unit in UNITS.items() if name.endswith("_" + end)), None)
