//! Units, which the names of fields end with.

/// How a unit is written, by the end of a name; longer ends come first. The Python package has the same.
const UNITS: [(&str, &str); 17] = [
    ("kg_m2", "kg m²"),
    ("rad_s2", "rad/s²"),
    ("rad_s", "rad/s"),
    ("rad2", "rad²"),
    ("m_s2", "m/s²"),
    ("m2", "m²"),
    ("m_s", "m/s"),
    ("n_m", "N m"),
    ("nm", "N m"),
    ("deg", "deg"),
    ("rad", "rad"),
    ("kg", "kg"),
    ("hz", "Hz"),
    ("ns", "ns"),
    ("s", "s"),
    ("m", "m"),
    ("n", "N"),
];

/// A field as the label of an axis: `velocity_w_m_s` is `velocity_w [m/s]`. A number without a unit stays as it is.
pub(crate) fn axis_label(field: &str) -> String {
    let name = field.rsplit('.').next().unwrap_or_default().split('[').next().unwrap_or_default();
    let split = |(end, unit): (&str, &str)| {
        let stem = name.strip_suffix(end)?.strip_suffix('_')?;
        Some(format!("{stem} [{unit}]"))
    };
    let labelled = UNITS.into_iter().find_map(split).filter(|_| !name.contains("_per_"));
    labelled.unwrap_or_else(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::{UNITS, axis_label};

    #[test]
    fn a_field_is_labelled_by_its_quantity_and_its_unit() {
        for (field, label) in [
            ("position_w_m[2]", "position_w [m]"),
            ("header.valid_ns", "valid [ns]"),
            ("points[0].velocity_w_m_s", "velocity_w [m/s]"),
            ("torque_nm", "torque [N m]"),
            ("iterations", "iterations"),
            ("steps_per_s", "steps_per_s"),
            ("s", "s"),
        ] {
            assert_eq!(axis_label(field), label);
        }
    }

    #[test]
    fn the_python_package_has_the_same_units() {
        let python = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/morphquad/units.py");
        let text = std::fs::read_to_string(python).unwrap();
        let (_, table) = text.split_once("UNITS = {").unwrap();
        let (table, _) = table.split_once('}').unwrap();
        let pairs =
            table.lines().filter_map(|line| line.trim().strip_suffix(',')?.split_once(": "));
        let quoted = |text: &str| text.trim_matches('"').to_owned();
        let pairs: Vec<_> = pairs.map(|(end, unit)| (quoted(end), quoted(unit))).collect();
        assert_eq!(pairs, UNITS.map(|(end, unit)| (end.to_owned(), unit.to_owned())));
    }
}
