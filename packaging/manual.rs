//! Writes the manual pages and the completion of shells, from the command line's own definition: `manual FOLDER`.
//!
//! A separate program: none of it is in the executable. The folder gets `man1/`, `bash/`, `zsh/` and `fish/`.

use clap_complete::{Shell, generate_to};
use clap_mangen::Man;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// Text of the page of `advee` itself beyond its commands; troff.
const FILES: &str = include_str!("advee.1.part");

fn main() -> io::Result<()> {
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    let folder = folder.ok_or_else(|| io::Error::new(ErrorKind::InvalidInput, "usage: manual FOLDER"))?;
    let command = cli::command();
    let pages = made(&folder.join("man1"))?;
    clap_mangen::generate_to(command.clone(), &pages)?;
    let mut page = Vec::new();
    Man::new(command.clone()).render(&mut page)?;
    page.extend_from_slice(FILES.as_bytes());
    fs::write(pages.join("advee.1"), page)?;
    for (shell, name) in [(Shell::Bash, "bash"), (Shell::Zsh, "zsh"), (Shell::Fish, "fish")] {
        generate_to(shell, &mut command.clone(), "advee", made(&folder.join(name))?)?;
    }
    Ok(())
}

fn made(folder: &Path) -> io::Result<PathBuf> {
    fs::create_dir_all(folder)?;
    Ok(folder.into())
}
