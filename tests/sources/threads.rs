//! A thread that cannot be had is an error with a reason, and ends no flight.

use super::docs::sources;
use std::fs;
use std::path::Path;

/// What panics where the system gives no thread, written so that this file has neither.
fn panicking() -> [String; 2] {
    ["thread::", "scope."].map(|of| format!("{of}spawn("))
}

#[test]
fn the_product_starts_no_thread_by_a_call_that_panics_without_one() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = ["services", "shared-types", "launcher"].map(|folder| sources(&root.join(folder)));
    let is_product = |path: &Path| {
        // Benchmarks are started by hand, on a machine that is theirs.
        !["tests", "tests.rs", "bench", "target"]
            .iter()
            .any(|part| path.iter().any(|it| it == *part))
    };
    let mut seen = 0;
    for path in files.iter().flatten().filter(|path| is_product(path)) {
        let text = fs::read_to_string(path).expect("a source");
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        seen += code.matches("Builder::new()").count();
        for call in panicking() {
            assert!(!code.contains(&call), "{}: take `std::thread::Builder`", path.display());
        }
    }
    assert!(seen > 10, "{seen}");
}
