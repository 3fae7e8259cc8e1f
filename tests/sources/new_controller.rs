//! What `new-controller` writes are the templates, which this workspace builds and tests. `.ci/new-controller`
//! builds such a crate outside of the workspace and flies it.

use std::fs;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

#[test]
fn a_new_controller_has_the_sources_of_its_template_byte_for_byte() {
    let folder = TempDir::new().expect("a folder");
    let templates = Path::new(env!("CARGO_MANIFEST_DIR")).join("launcher/templates");
    for slot in ["attitude", "position"] {
        let (name, dir) = (format!("my-{slot}-controller"), folder.path().join(slot));
        let written = Command::new(env!("CARGO_BIN_EXE_morphquad"))
            .args(["new-controller", &name, "--slot", slot, "--dir"])
            .arg(&dir)
            .output()
            .expect("the executable starts");
        assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
        let template = templates.join(format!("{slot}-controller"));
        for file in ["src/main.rs", "src/lib.rs"] {
            let read = |folder: &Path| fs::read(folder.join(file)).expect("a source");
            assert!(read(&dir) == read(&template), "{slot}: {file}");
        }
    }
}
