//! The `advee` executable.
#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    cli::main()
}
