//! Where the official LCM of each version is, and how programs are built on it.

use lcm::url;
use std::ffi::OsString;
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
    Java,
    /// The bus by our own class, `examples/modules/csharp/Lcm.cs`.
    CSharp,
}

impl Language {
    /// Those that a version is had for; Debian packages no Python module.
    pub fn of(version: &str) -> &'static [Self] {
        match version {
            "1.3.1" => &[Self::C, Self::Cpp],
            _ => &[Self::C, Self::Cpp, Self::Python, Self::Java, Self::CSharp],
        }
    }

    /// `None` if its compiler or interpreter is missing, and its column is not checked.
    pub fn find(self) -> Option<()> {
        let programs: &[&str] = match self {
            Self::C | Self::Cpp | Self::Python => &[],
            Self::Java => &["javac", "java"],
            Self::CSharp => &["mcs", "mono"],
        };
        programs.iter().try_for_each(|program| peer_or_skip(testing::tool(program, "--version")))
    }
}

impl fmt::Display for Language {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::C => "C",
            Self::Cpp => "C++",
            Self::Python => "Python",
            Self::Java => "Java",
            Self::CSharp => "C#",
        })
    }
}

impl Language {
    /// The source of the peer.
    pub fn source(self) -> PathBuf {
        root().join("foundation/lcm/tests/peers").join(match self {
            Self::C => "peer.c",
            Self::Cpp => "peer.cpp",
            Self::Python => "peer.py",
            Self::Java => "Peer.java",
            Self::CSharp => "peer.cs",
        })
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
            Language::Java => lcm_gen.arg("--java").arg("--jpath").arg(out),
            Language::CSharp => lcm_gen.arg("--csharp").arg("--csharp-path").arg(out),
        };
        run(lcm_gen.arg(file))
    }

    /// A program of ours: `source` compiled with all generated code in `folder` and linked, or a script.
    pub fn program(&self, language: Language, folder: &Path, source: PathBuf) -> Result<Program, String> {
        let program = |path: PathBuf, arguments: &[&Path]| {
            let arguments = arguments.iter().copied().map(Into::into).collect();
            Ok(Program { path, arguments, folder: folder.into() })
        };
        match language {
            Language::Python => return program(self.python.clone().expect("1.5.3 has one"), &[&source]),
            Language::Java => {
                let (jar, classes) = (self.prefix.join("share/java/lcm.jar"), folder.join("classes"));
                let mut javac = Command::new("javac");
                javac.args(["--release", "11", "-nowarn", "-d"]).arg(&classes).arg("-cp").arg(&jar);
                run(javac.args(files(folder, "java")).arg(source))?;
                let path = format!("{}:{}", classes.display(), jar.display());
                return program("java".into(), &["-cp".as_ref(), path.as_ref(), "Peer".as_ref()]);
            }
            Language::CSharp => {
                let (bus, made) = (root().join("examples/modules/csharp/Lcm.cs"), folder.join("peer.exe"));
                let mut mcs = Command::new("mcs");
                mcs.arg(format!("-out:{}", made.display())).args([bus, source]).args(files(folder, "cs"));
                run(&mut mcs)?;
                return program("mono".into(), &[&made]);
            }
            Language::C | Language::Cpp => {}
        }
        let (compiler, standard) = if language == Language::C { ("cc", "-std=gnu11") } else { ("c++", "-std=c++11") };
        let library = self.prefix.join("lib");
        let mut compiler = Command::new(compiler);
        compiler
            .args([standard, "-w", "-I."])
            .arg("-I")
            .arg(self.prefix.join("include"))
            .arg(source)
            .args(files(folder, "c"));
        compiler.args(["-o", "program", "-l:liblcm.so.1"]).arg("-L").arg(&library);
        compiler.arg("-Wl,-rpath").arg(format!("-Wl,{}", library.display()));
        run(compiler.current_dir(folder))?;
        program(folder.join("program"), &[])
    }
}

/// A program or script of ours on the official LCM.
pub struct Program {
    /// What is executed.
    pub path: PathBuf,
    /// Its first arguments, where it is an interpreter.
    pub arguments: Vec<OsString>,
    /// Where what `lcm-gen` made for it is.
    pub folder: PathBuf,
}

impl Program {
    /// It, to be given its arguments.
    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.path);
        command.args(&self.arguments).env("PYTHONPATH", &self.folder).env("PYTHONDONTWRITEBYTECODE", "1");
        command
    }
}

impl Drop for Official {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.scratch);
    }
}

/// The files in a folder and those below it whose names end so.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let (folders, mut found): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    found.retain(|path| path.extension().is_some_and(|its| its == extension));
    found.extend(folders.iter().flat_map(|folder| files(folder, extension)));
    found
}

/// Runs it to its end; what it said when that was none.
pub fn run(command: &mut Command) -> Result<(), String> {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said = || format!("{command:?}: {}", String::from_utf8_lossy(&[output.stderr, output.stdout].concat()));
    if output.status.success() { Ok(()) } else { Err(said()) }
}
