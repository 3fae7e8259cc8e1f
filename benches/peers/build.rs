//! copper-rs asks every application for a folder of its log's strings.

fn main() {
    println!("cargo:rustc-env=LOG_INDEX_DIR={}", std::env::var("OUT_DIR").unwrap_or_default());
}
