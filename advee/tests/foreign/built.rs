//! Example modules, built by their own Makefile.

use crate::support::{python, workspace};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use testing::{machine_or_skip, peer_or_skip, tool};

/// Modules on the Python package, `lcm` 1.5.3, or on the library of Debian 12, 1.3.1, which has no Python binding.
pub struct Built {
    pub folder: PathBuf,
    python: Option<PathBuf>,
}

impl Built {
    /// Built on 1.5.3; `None` if the test is skipped.
    pub fn on_the_wheel() -> Option<&'static Self> {
        static BUILT: OnceLock<Built> = OnceLock::new();
        let python = python()?;
        may_build()?;
        let make = || {
            let path = format!("PYTHON={}", python.display());
            Self::make("1.5.3", &["all", "cpp/broken_cpp"], path, Some(python))
        };
        Some(BUILT.get_or_init(make))
    }

    /// Built on 1.3.1.
    pub fn on_debians() -> Option<&'static Self> {
        static BUILT: OnceLock<Built> = OnceLock::new();
        let prefix = peer_or_skip(testing::lcm_1_3_1())?;
        may_build()?;
        let make = || Self::make("1.3.1", &["cpp"], format!("P={}", prefix.display()), None);
        Some(BUILT.get_or_init(make))
    }

    fn make(version: &str, what: &[&str], variable: String, python: Option<PathBuf>) -> Self {
        // Kept for the next run: unchanged files are not built again.
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("foreign-modules-{version}"));
        copy(&workspace().join("examples/modules"), &folder);
        for language in ["python", "cpp"] {
            copy(&workspace().join("advee/tests/foreign").join(language), &folder.join(language));
        }
        let made = Command::new("make")
            .args(what)
            .arg("-C")
            .arg(&folder)
            .args([format!("ROOT={}", workspace().display()), variable, "CXXFLAGS=-Wall -Wextra -Werror".into()])
            .output()
            .expect("make runs");
        let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(made.status.success(), "{}{}", said(&made.stdout), said(&made.stderr));
        Self { folder, python }
    }

    /// Command line of a module: `nearest_obstacle` and `broken_cpp` in C++, the others in Python.
    pub fn command(&self, module: &str) -> Vec<String> {
        let text = |path: &Path| path.to_str().expect("UTF-8").to_string();
        let binary = self.folder.join("cpp").join(module);
        match &self.python {
            _ if binary.exists() => vec![text(&binary)],
            Some(python) => vec![text(python), text(&self.folder.join("python").join(format!("{module}.py")))],
            None => panic!("{module} needs Python"),
        }
    }
}

/// Requirements for building and running a module on the official library.
fn may_build() -> Option<()> {
    for name in ["make", "c++"] {
        peer_or_skip(tool(name, "--version"))?;
    }
    // The LCM of this project does not need a route.
    machine_or_skip(testing::multicast_route(lcm::url::GROUP, lcm::url::PORT))
}

/// Copies the files that are missing or differ; other files remain.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("an entry");
        let (path, target) = (entry.path(), to.join(entry.file_name()));
        match path.is_dir() {
            true if ["types", "__pycache__"].iter().any(|made| entry.file_name() == *made) => {}
            true => copy(&path, &target),
            false => {
                let [source, there] = [&path, &target].map(|path| fs::read(path).ok());
                // Files compiled in the checkout are not copied.
                let is_source = path.extension().is_some() || path.ends_with("Makefile");
                if is_source && source != there {
                    fs::write(&target, source.expect("readable")).expect("writable");
                }
            }
        }
    }
}
