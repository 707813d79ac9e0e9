//! Example modules, built by their own Makefile.

use crate::support::{python, workspace};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use testing::{machine_or_skip, peer_or_skip, tool};

/// A module: language, which is its folder, and name.
pub type Foreign = (&'static str, &'static str);

/// Modules on the Python package, `lcm` 1.5.3, or on the library of Debian 12, 1.3.1, which has no Python binding.
pub struct Built {
    pub folder: PathBuf,
    python: Option<PathBuf>,
}

impl Built {
    /// Built on 1.5.3; `None` if the test is skipped.
    pub fn on_the_wheel() -> Option<&'static Self> {
        static BUILT: OnceLock<Built> = OnceLock::new();
        Self::once(&BUILT, "1.5.3", &["all", "c/broken_c", "cpp/broken_cpp"], &[])
    }

    /// In Java, on 1.5.3.
    pub fn in_java() -> Option<&'static Self> {
        static BUILT: OnceLock<Built> = OnceLock::new();
        Self::once(&BUILT, "java", &["java"], &["javac", "java"])
    }

    /// In C#, on a bus class of our own and the types by 1.5.3.
    pub fn in_csharp() -> Option<&'static Self> {
        static BUILT: OnceLock<Built> = OnceLock::new();
        Self::once(&BUILT, "csharp", &["csharp", "csharp/Broken.exe", "csharp/Hostile.exe"], &["mcs", "mono"])
    }

    /// Made by the Python package and these programs, once.
    fn once(built: &'static OnceLock<Self>, folder: &str, what: &[&str], programs: &[&str]) -> Option<&'static Self> {
        let python = python()?;
        may_build()?;
        for program in programs {
            peer_or_skip(tool(program, "--version"))?;
        }
        let variable = format!("PYTHON={}", python.display());
        Some(built.get_or_init(|| Self::make(folder, what, variable, Some(python))))
    }

    /// Built on 1.3.1.
    pub fn on_debians() -> Option<&'static Self> {
        static BUILT: OnceLock<Built> = OnceLock::new();
        let prefix = peer_or_skip(testing::lcm_1_3_1())?;
        may_build()?;
        let make = || Self::make("1.3.1", &["c", "cpp"], format!("P={}", prefix.display()), None);
        Some(BUILT.get_or_init(make))
    }

    fn make(version: &str, what: &[&str], variable: String, python: Option<PathBuf>) -> Self {
        // Kept for the next run: unchanged files are not built again.
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("foreign-modules-{version}"));
        copy(&workspace().join("examples/modules"), &folder);
        for language in ["python", "c", "cpp", "java", "csharp"] {
            copy(&workspace().join("advee/tests/foreign").join(language), &folder.join(language));
        }
        let made = Command::new("make")
            .args(what)
            .arg("-C")
            .arg(&folder)
            .args([format!("ROOT={}", workspace().display()), variable])
            .args(["CFLAGS=-Wall -Wextra -Werror", "CXXFLAGS=-Wall -Wextra -Werror"])
            .args(["JAVACFLAGS=-Werror", "MCSFLAGS=-warnaserror+"])
            .output()
            .expect("make runs");
        let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(made.status.success(), "{}{}", said(&made.stdout), said(&made.stderr));
        Self { folder, python }
    }

    /// Command line of a module in `folder` of the examples, its language.
    pub fn command(&self, (language, module): Foreign) -> Vec<String> {
        let text = |path: &Path| path.to_str().expect("UTF-8").to_string();
        let program = self.folder.join(language).join(module);
        match (language, &self.python) {
            ("python", Some(python)) => vec![text(python), text(&program.with_extension("py"))],
            ("java", Some(python)) => {
                let jar = wheel_of(python).join("share/java/lcm.jar");
                let path = format!("{}:{}", text(&self.folder.join("java/classes")), text(&jar));
                ["java", "-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1", "-cp", &path, class(module)]
                    .map(String::from)
                    .into()
            }
            ("csharp", Some(_)) => {
                vec!["mono".into(), text(&program.with_file_name(class(module)).with_extension("exe"))]
            }
            ("c" | "cpp", _) => vec![text(&program)],
            _ => panic!("{module} needs Python"),
        }
    }
}

/// Class of a module in Java or C#.
fn class(module: &str) -> &'static str {
    match module {
        "battery_watch" => "BatteryWatch",
        "presentation" => "Presentation",
        "hostile" => "Hostile",
        _ => "Broken",
    }
}

/// Where the Python package has its other files.
fn wheel_of(python: &Path) -> PathBuf {
    let found = Command::new(python).args(["-c", "import lcm; print(lcm.__file__)"]).output().expect("it runs");
    let module = PathBuf::from(String::from_utf8_lossy(&found.stdout).trim());
    module.ancestors().nth(2).expect("it is in a folder").into()
}

/// Requirements for building and running a module on the official library.
fn may_build() -> Option<()> {
    for name in ["make", "cc", "c++"] {
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
            true if ["types", "__pycache__", "classes"].iter().any(|made| entry.file_name() == *made) => {}
            true => copy(&path, &target),
            false => {
                let [source, there] = [&path, &target].map(|path| fs::read(path).ok());
                // Files compiled in the checkout are not copied.
                let is_source =
                    path.extension().map_or_else(|| path.ends_with("Makefile"), |extension| extension != "exe");
                if is_source && source != there {
                    fs::write(&target, source.expect("readable")).expect("writable");
                }
            }
        }
    }
}
