//! Where the official LCM of each version is, and how programs are built on it.

use lcm::url;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{fmt, fs};
use testing::{Found, machine_or_skip, peer_or_skip};

/// The wheel of the Python package, and Debian 12's packages.
pub const VERSIONS: [&str; 2] = ["1.5.3", "1.3.1"];

/// The official LCM of one version.
pub struct Official {
    /// One of [`VERSIONS`].
    pub version: &'static str,
    /// Where bin, include and lib are.
    prefix: PathBuf,
    /// The Python that has the package; none for 1.3.1.
    python: Option<PathBuf>,
    /// For what is built; goes with this.
    scratch: PathBuf,
}

/// A language that a peer is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    C,
    Cpp,
    Python,
}

impl Language {
    /// Those that a version is had for; Debian packages no Python module.
    pub fn of(version: &str) -> &'static [Self] {
        match version {
            "1.3.1" => &[Self::C, Self::Cpp],
            _ => &[Self::C, Self::Cpp, Self::Python],
        }
    }
}

impl fmt::Display for Language {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::C => "C",
            Self::Cpp => "C++",
            Self::Python => "Python",
        })
    }
}

impl Language {
    /// Of its sources' names.
    pub fn extension(self) -> &'static str {
        match self {
            Self::C => "c",
            Self::Cpp => "cpp",
            Self::Python => "py",
        }
    }
}

/// The checkout.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// A Python with the official LCM, and what it is installed under.
fn wheel() -> Found<(PathBuf, PathBuf)> {
    let python = testing::python(&["lcm"])?;
    let found = Command::new(&python).args(["-c", "import lcm; print(lcm.__file__)"]).output().unwrap();
    let module = PathBuf::from(String::from_utf8(found.stdout).unwrap().trim());
    Ok((module.ancestors().nth(2).unwrap().into(), python))
}

impl Official {
    /// Finds it; `None` where it is skipped, and its columns are not checked. `purpose` names the test's folder.
    pub fn find(version: &'static str, purpose: &str) -> Option<Self> {
        let found = match version {
            "1.3.1" => testing::lcm_1_3_1().map(|prefix| (prefix, None)),
            _ => wheel().map(|(prefix, python)| (prefix, Some(python))),
        };
        let (prefix, python) = peer_or_skip(found)?;
        for compiler in ["cc", "c++"] {
            peer_or_skip(testing::tool(compiler, "--version"))?;
        }
        machine_or_skip(testing::multicast_route(url::GROUP, url::PORT))?;
        let scratch = format!("interop-{purpose}-{version}-{}", std::process::id());
        let scratch = Path::new(env!("CARGO_TARGET_TMPDIR")).join(scratch);
        Some(Self { version, prefix, python, scratch })
    }

    /// A folder for what is built, `what` of it.
    pub fn folder(&self, language: impl fmt::Display, what: &str) -> PathBuf {
        let folder = self.scratch.join(language.to_string()).join(what);
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    /// One of the official programs.
    pub fn tool(&self, name: &str) -> Command {
        let mut command = Command::new(self.prefix.join("bin").join(name));
        command.env("LD_LIBRARY_PATH", self.prefix.join("lib"));
        command
    }

    /// Runs `lcm-gen` on one file (it carries the package of one over to the next); says why when it refuses.
    pub fn generate(&self, language: Language, file: &Path, out: &Path) -> Result<(), String> {
        let mut lcm_gen = self.tool("lcm-gen");
        match language {
            Language::C => lcm_gen.arg("-c").arg("--c-cpath").arg(out).arg("--c-hpath").arg(out),
            // The default is C++98, where a constant of type double does not compile; 1.3.1 has no such option.
            Language::Cpp if self.version != "1.3.1" => {
                lcm_gen.args(["-x", "--cpp-std", "c++11"]).arg("--cpp-hpath").arg(out)
            }
            Language::Cpp => lcm_gen.arg("-x").arg("--cpp-hpath").arg(out),
            Language::Python => lcm_gen.arg("-p").arg("--ppath").arg(out),
        };
        run(lcm_gen.arg(file))
    }

    /// A program of ours: `source` compiled with all generated C beside it in `folder` and linked, or a script.
    pub fn program(&self, language: Language, folder: &Path, source: PathBuf) -> Result<Program, String> {
        if language == Language::Python {
            let path = self.python.clone().expect("1.5.3 has one");
            return Ok(Program { path, script: Some(source), folder: folder.into() });
        }
        let (compiler, standard) = if language == Language::C { ("cc", "-std=gnu11") } else { ("c++", "-std=c++11") };
        let generated = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let generated = generated.filter(|path| path.extension().is_some_and(|extension| extension == "c"));
        let library = self.prefix.join("lib");
        let mut compiler = Command::new(compiler);
        compiler.args([standard, "-w", "-I."]).arg("-I").arg(self.prefix.join("include")).arg(source).args(generated);
        compiler.args(["-o", "program", "-l:liblcm.so.1"]).arg("-L").arg(&library);
        compiler.arg("-Wl,-rpath").arg(format!("-Wl,{}", library.display()));
        run(compiler.current_dir(folder))?;
        Ok(Program { path: folder.join("program"), script: None, folder: folder.into() })
    }
}

/// A program or script of ours on the official LCM.
pub struct Program {
    /// What is executed.
    pub path: PathBuf,
    /// Its first argument, where it is an interpreter.
    pub script: Option<PathBuf>,
    /// Where what `lcm-gen` made for it is.
    pub folder: PathBuf,
}

impl Program {
    /// It, to be given its arguments.
    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.path);
        command.args(&self.script).env("PYTHONPATH", &self.folder).env("PYTHONDONTWRITEBYTECODE", "1");
        command
    }
}

impl Drop for Official {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.scratch);
    }
}

/// Runs it to its end; what it said when that was none.
pub fn run(command: &mut Command) -> Result<(), String> {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said = || format!("{command:?}: {}", String::from_utf8_lossy(&[output.stderr, output.stdout].concat()));
    if output.status.success() { Ok(()) } else { Err(said()) }
}
