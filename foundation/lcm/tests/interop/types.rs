//! Types: what the official `lcm-gen` makes of the vectors and of the robot's messages, and what ours does.

use crate::official::{Language, Official, Program, VERSIONS, root, run};
use crate::vectors::{Nopkg, advee, vec};
use lcm::codec::Type;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Types that official code is no peer for.
pub struct Defect {
    /// What is wrong, under the table.
    pub reason: &'static str,
    files: &'static [&'static str],
    types: &'static [&'static str],
    holds: fn(Language, &str) -> bool,
}

/// Every one of them is shown to be one in each run.
pub const DEFECTS: [Defect; 4] = [
    Defect {
        reason: "`lcm-gen` 1.3.1 knows no constants as dimensions",
        files: &["constants_t"],
        types: &["vec.constants_t"],
        holds: |_, version| version == VERSIONS[1],
    },
    Defect {
        reason: "the Python code of `lcm-gen` cannot decode an array whose last dimension is written in hexadecimal",
        files: &["constants_t"],
        types: &["vec.constants_t"],
        holds: |language, _| language == Language::Python,
    },
    Defect {
        reason: "`lcm-gen` makes of an enum no C++, C# that does not compile, and Python that cannot construct what holds it",
        files: &["enum_legacy_t"],
        types: &["vec.enum_user_t"],
        holds: |language, _| matches!(language, Language::Cpp | Language::Python | Language::CSharp),
    },
    Defect {
        reason: "the C and C++ headers of types that hold each other include each other and do not compile",
        files: &["ping_t", "pong_t"],
        types: &["vec.ping_t", "vec.pong_t"],
        holds: |language, _| matches!(language, Language::C | Language::Cpp),
    },
];

/// What a peer is built of.
pub struct Built {
    /// The program; it knows the types without a defect.
    pub program: Program,
    /// The types of the vectors, and the defects of this peer by their place in [`DEFECTS`].
    pub types: Vec<(String, Option<usize>)>,
}

/// Generates and builds everything in one language, the vectors' types and the robot's; panics where that fails without
/// being a known defect, or does not fail where it is one.
pub fn build(official: &Official, language: Language) -> Built {
    let version = official.version;
    let mut files = lcm_files(&vectors().join("types"));
    for (number, defect) in DEFECTS.iter().enumerate().filter(|(_, defect)| (defect.holds)(language, version)) {
        let hit = |file: &PathBuf| defect.files.iter().any(|stem| *stem == file.file_stem().unwrap());
        let apart: Vec<PathBuf> = files.extract_if(.., |file| hit(file)).collect();
        for name in defect.types {
            let folder = official.folder(language, &format!("defect-{number}-{name}"));
            let fate = peer(official, language, &folder, &apart, &[(*name).into()]);
            assert!(fate.is_err(), "{name} works in {language} {version}: no defect any more");
        }
    }
    let mut names: Vec<String> = encoded().into_iter().map(|(name, _)| name).collect();
    names.dedup();
    let fits = |defect: &Defect, name: &str| (defect.holds)(language, version) && defect.types.contains(&name);
    let defect = |name: String| (DEFECTS.iter().position(|defect| fits(defect, &name)), name);
    let types: Vec<_> = names.into_iter().map(defect).map(|(defect, name)| (name, defect)).collect();

    let robot = robot_files();
    let mut known: Vec<String> = types.iter().filter(|it| it.1.is_none()).map(|it| it.0.clone()).collect();
    known.extend(definitions(&robot));
    files.extend(robot);
    let program = peer(official, language, &official.folder(language, "peer"), &files, &known);
    Built { program: program.unwrap_or_else(|error| panic!("{language} {version}: {error}")), types }
}

/// The peer of that language, with these files generated and these types subscribed to; what the tools say when they
/// refuse.
fn peer(
    official: &Official,
    language: Language,
    folder: &Path,
    files: &[PathBuf],
    types: &[String],
) -> Result<Program, String> {
    for file in files {
        official.generate(language, file, folder)?;
    }
    match language {
        Language::C => fs::write(folder.join("types.h"), list(language, types)).unwrap(),
        Language::Cpp => fs::write(folder.join("types.hpp"), list(language, types)).unwrap(),
        Language::Python | Language::Java | Language::CSharp => {}
    }
    let program = official.program(language, folder, language.source())?;
    if !matches!(language, Language::C | Language::Cpp) {
        run(program.command().arg("types").args(types))?;
    }
    Ok(program)
}

/// The header that the peers in C and C++ know their types by.
fn list(language: Language, types: &[String]) -> String {
    let cpp = language == Language::Cpp;
    let include = |name: &String| match cpp {
        true => format!("#include \"{}.hpp\"\n", name.replace('.', "/")),
        false => format!("#include \"{}.h\"\n", channel(name)),
    };
    let entry = |name: &String| match cpp {
        true => format!(" \\\n    T({}, \"{}\")", name.replace('.', "::"), channel(name)),
        false => format!(" \\\n    T({})", channel(name)),
    };
    let includes: String = types.iter().map(include).collect();
    let entries: String = types.iter().map(entry).collect();
    format!("{includes}#define EACH_TYPE(T){entries}\n")
}

/// The channel that a type's messages go over, which is its name in C: `vec_geom_point_t`.
pub fn channel(name: &str) -> String {
    name.replace('.', "_")
}

fn vectors() -> PathBuf {
    root().join("foundation/lcm-gen/tests/vectors")
}

/// The `.lcm` files in a folder, in order.
fn lcm_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "lcm"));
    files.sort();
    files
}

/// The robot's definitions.
pub fn robot_files() -> Vec<PathBuf> {
    let packages = fs::read_dir(root().join("messages")).unwrap().map(|entry| entry.unwrap().path());
    packages.filter(|path| path.is_dir()).flat_map(|folder| lcm_files(&folder)).collect()
}

/// The names of all types in these files.
fn definitions(files: &[PathBuf]) -> Vec<String> {
    let texts: Vec<_> =
        files.iter().map(|file| (file.display().to_string(), fs::read_to_string(file).unwrap())).collect();
    let schema = lcm_gen::Schema::new(&texts).unwrap();
    schema.definitions().iter().map(lcm_gen::Definition::name).collect()
}

/// Type and bytes of every vector, as the official tools encoded them; those of one type follow each other.
pub fn encoded() -> Vec<(String, Vec<u8>)> {
    let text = fs::read_to_string(vectors().join("vectors.json")).unwrap();
    let json: Value = serde_json::from_str(&text).unwrap();
    let text = |message: &Value, key: &str| message[key].as_str().unwrap().to_string();
    let mut all: Vec<_> =
        json["messages"].as_array().unwrap().iter().map(|m| (text(m, "type"), hex(&text(m, "hex")))).collect();
    all.sort();
    all
}

fn hex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).unwrap()).collect()
}

macro_rules! types {
    ($($type:ty),* $(,)?) => {
        /// The message, decoded and encoded anew by the Rust code of `lcm-gen`.
        pub fn again(name: &str, bytes: &[u8]) -> Vec<u8> {
            let mut out = Vec::new();
            match name {
                $(<$type>::NAME => <$type>::decode(bytes).unwrap().encode(&mut out).unwrap(),)*
                _ => panic!("no type {name} here"),
            }
            out
        }
    };
}

types![
    advee::RangeScan,
    Nopkg,
    vec::Arrays,
    vec::Constants,
    vec::ConstantsDec,
    vec::deep::er::Wrapper,
    vec::Empty,
    vec::EnumUser,
    vec::geom::Point,
    vec::Nested,
    vec::other::SeveralC,
    vec::Ping,
    vec::Pong,
    vec::Primitives,
    vec::SeveralB,
    vec::Tree,
];
