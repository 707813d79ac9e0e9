//! The example modules, made ready to run by their own Makefile.

use crate::support::{python, workspace};
use std::fs;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Those on the Python package, `lcm` 1.5.3, and those on Debian 12's library, 1.3.1, which has no Python.
pub struct Built {
    pub folder: PathBuf,
    python: Option<PathBuf>,
}

impl Built {
    /// On 1.5.3; none, and a line that says so, where something is missing.
    pub fn on_the_wheel() -> Option<&'static Self> {
        static BUILT: OnceLock<Option<Built>> = OnceLock::new();
        BUILT.get_or_init(|| {
            let python = python()?;
            Self::make("1.5.3", &["all", "cpp/broken_cpp"], format!("PYTHON={}", python.display()), Some(python))
        });
        BUILT.get()?.as_ref()
    }

    /// On 1.3.1.
    pub fn on_debians() -> Option<&'static Self> {
        static BUILT: OnceLock<Option<Built>> = OnceLock::new();
        BUILT.get_or_init(|| {
            let prefix = workspace().join(".peers/lcm-1.3.1");
            if !prefix.join("version").exists() {
                println!("skipped: official LCM 1.3.1 is not here, make test gets it");
                return None;
            }
            Self::make("1.3.1", &["cpp"], format!("P={}", prefix.display()), None)
        });
        BUILT.get()?.as_ref()
    }

    fn make(version: &str, what: &[&str], variable: String, python: Option<PathBuf>) -> Option<Self> {
        for tool in ["make", "c++"] {
            if Command::new(tool).arg("--version").output().is_err() {
                println!("skipped: modules on official LCM {version}: no {tool}");
                return None;
            }
        }
        // Ours does without.
        let group = (lcm::url::GROUP, lcm::url::PORT);
        if UdpSocket::bind("0.0.0.0:0").and_then(|socket| socket.connect(group)).is_err() {
            println!("skipped: modules on official LCM {version}: it needs a route to its group");
            return None;
        }
        // Kept for the next run: what has not changed is not made again.
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("foreign-modules-{version}"));
        copy(&workspace().join("examples/modules"), &folder);
        for language in ["python", "cpp"] {
            copy(&workspace().join("robot/tests/foreign").join(language), &folder.join(language));
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
        Some(Self { folder, python })
    }

    /// The command line of a module: `nearest_obstacle` and `broken_cpp` in C++, the others in Python.
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

/// Copies the files that are not there, or others; what else is there, remains.
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
                // What somebody has compiled in the checkout is his.
                let is_source = path.extension().is_some() || path.ends_with("Makefile");
                if is_source && source != there {
                    fs::write(&target, source.expect("readable")).expect("writable");
                }
            }
        }
    }
}
