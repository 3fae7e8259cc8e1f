//! The scenarios inside the executable.

/// Name and text of each, in the order in which they are listed.
pub const SHIPPED: [(&str, &str); 4] = [
    ("hover", include_str!("../shipped/hover.toml")),
    ("figure8-morph", include_str!("../shipped/figure8-morph.toml")),
    ("attitude-step", include_str!("../shipped/attitude-step.toml")),
    ("disturbance", include_str!("../shipped/disturbance.toml")),
];

/// What `morphquad demo` flies; it is too long for a list from which every scenario is flown by tests.
pub const DEMO: &str = include_str!("../shipped/demo.toml");

/// Names of all.
pub fn names() -> impl Iterator<Item = &'static str> + Clone {
    SHIPPED.iter().map(|(name, _)| *name)
}

/// Text of one.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    SHIPPED.iter().find(|(shipped, _)| *shipped == name).map(|(_, text)| *text)
}
