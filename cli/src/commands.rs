//! Declaration of a command's subcommands.

/// Declares the subcommands of a command, each with its arguments and what it runs, and the method `run`. The first
/// line names what is passed on: the arguments of all commands, and the subcommand's own.
macro_rules! commands {
    (
        |$common:ident, $arguments:ident|
        $(#[$attribute:meta])*
        $visibility:vis enum $name:ident {
            $($(#[$help:meta])* $command:ident($type:ty) => $run:expr,)+
        }
    ) => {
        $(#[$attribute])*
        #[derive(clap::Subcommand)]
        $visibility enum $name {
            $($(#[$help])* $command($type),)+
        }

        impl $name {
            /// Runs the subcommand.
            pub fn run(&self, $common: &$crate::Common) -> $crate::Outcome {
                match self {
                    $(Self::$command($arguments) => $run,)+
                }
            }
        }
    };
}

pub(crate) use commands;
