//! The `advee` executable.

fn main() -> std::process::ExitCode {
    robot::cli::main()
}
