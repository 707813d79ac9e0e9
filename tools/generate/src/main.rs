//! `make generate`: writes the files that are made from the source.
#![forbid(unsafe_code)]

use std::fs;
use std::process::ExitCode;

fn main() -> ExitCode {
    let done = generate::outputs(&generate::root()).and_then(|outputs| {
        for output in outputs {
            let path = generate::root().join(&*output.path);
            if fs::read_to_string(&path).is_ok_and(|text| text == output.text) {
                continue;
            }
            if let Some(folder) = path.parent() {
                fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
            }
            fs::write(&path, &output.text).map_err(|error| format!("{}: {error}", output.path))?;
            println!("{}", output.path);
        }
        Ok(())
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}: {error}", env!("CARGO_PKG_NAME"));
            ExitCode::FAILURE
        }
    }
}
