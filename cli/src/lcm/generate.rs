//! `advee lcm gen`: Rust from `.lcm` files.

use crate::{Outcome, print};
use lcm_gen::rust::{self, Options, Serde};
use lcm_gen::{Schema, build};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Generator of the other languages.
const OTHERS: &str =
    "C, C++, Python, Java: the official lcm-gen on the same files (pip install lcm): lcm-gen -c|-x|-p|-j FILES";

/// The code needs the crate `lcm`; without its features it is no_std.
#[derive(clap::Args)]
#[command(after_help = OTHERS)]
pub struct Gen {
    /// Files, and folders with .lcm files in and below them
    #[arg(required = true, value_name = "FILES|DIRS")]
    places: Vec<PathBuf>,
    /// NAME.rs: one file; else a folder: mod.rs and a file for each package [default: stdout]
    #[arg(long, value_name = "FILE|DIR")]
    out: Option<PathBuf>,
    /// Write nothing: check the types and, with --out, that the files there are up to date
    #[arg(long)]
    check: bool,
    /// Types that borrow strings and arrays from a message beside those that own them
    #[arg(long)]
    views: bool,
    /// Which of serde's traits the types derive
    #[arg(long, value_enum, default_value = "none")]
    serde: Derive,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Derive {
    None,
    Serialize,
    Both,
}

pub fn generate(command: &Gen) -> Outcome {
    let serde = match command.serde {
        Derive::None => Serde::None,
        Derive::Serialize => Serde::Serialize,
        Derive::Both => Serde::Both,
    };
    let options = Options { serde, views: command.views };
    let schema = build::read(&command.places)?;
    let files = match &command.out {
        Some(folder) if folder.extension().is_none_or(|extension| extension != "rs") => {
            in_folder(&schema, &options, folder)
        }
        Some(file) => rust::generate(&schema, &options).map(|code| vec![(file.clone(), code)]),
        None => rust::generate(&schema, &options).map(|code| vec![(PathBuf::new(), code)]),
    };
    let files = files.map_err(|error| error.to_string())?;
    match (&command.out, command.check) {
        (None, false) => print(files[0].1.trim_end())?,
        (None, true) => {}
        (Some(_), true) => {
            if let Some((path, _)) =
                files.iter().find(|(path, code)| fs::read(path).ok().as_deref() != Some(code.as_bytes()))
            {
                return Err(format!("{}: is not what the types would give", path.display()).into());
            }
        }
        (Some(out), false) => {
            files.iter().try_for_each(|(path, code)| write(path, code))?;
            print(format_args!("{}: {} types\n{OTHERS}", out.display(), schema.definitions().len()))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn in_folder(schema: &Schema, options: &Options, folder: &Path) -> Result<Vec<(PathBuf, String)>, lcm_gen::Error> {
    let files = rust::generate_files(schema, options)?;
    Ok(files.into_iter().map(|(name, code)| (folder.join(name), code)).collect())
}

fn write(path: &Path, code: &str) -> Result<(), String> {
    let folder = path.parent().map_or(Ok(()), fs::create_dir_all);
    folder.and_then(|()| fs::write(path, code)).map_err(|error| format!("{}: {error}", path.display()))
}
