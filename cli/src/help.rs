//! The list of commands in `advee help`: in groups, each with examples.

use clap::Command;
use std::fmt::Write;

/// A group of commands, and examples of it.
struct Group {
    name: &'static str,
    commands: &'static [&'static str],
    examples: &'static [&'static str],
}

const GROUPS: [Group; 5] = [
    Group {
        name: "Run",
        commands: &["up", "run", "web", "bridge", "doctor", "config"],
        examples: &["advee up --sim", "advee doctor --sim"],
    },
    Group {
        name: "Operate",
        commands: &[
            "diag",
            "state",
            "errors",
            "level",
            "drive",
            "goal",
            "mode",
            "parameters",
            "action",
            "pose",
            "beacons",
            "home",
            "power",
            "io",
            "lidar",
            "imu",
        ],
        examples: &["advee goal 12,3 --wait", "advee drive 0.3 0 --for 2"],
    },
    Group {
        name: "Look back",
        commands: &["log", "plot", "replay", "estimate"],
        examples: &["advee log info log/RUN", "advee plot log/RUN"],
    },
    Group {
        name: "Buses",
        commands: &["lcm", "can", "rs485", "i2c", "bench"],
        examples: &["advee lcm echo LL_DATA_MOTION", "advee can monitor --changes"],
    },
    Group {
        name: "Develop",
        commands: &["fault", "sim", "soak", "gym", "plan", "world", "completion"],
        examples: &["advee fault psc1 bumper 2 --for 1", "advee soak --hours 1"],
    },
];

/// The command with its subcommands listed in groups.
pub fn grouped(command: Command) -> Command {
    let list = list(&command);
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}Options of all commands:\n{{options}}\n\n\
         advee help COMMAND describes one command."
    );
    command.help_template(template)
}

fn list(command: &Command) -> String {
    let mut text = String::new();
    for Group { name, commands, examples } in GROUPS {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{name}:");
        for name in commands {
            let about = command.find_subcommand(name).and_then(Command::get_about);
            let _ = writeln!(text, "  {name:<10}  {}", about.map(ToString::to_string).unwrap_or_default());
        }
        let _ = writeln!(text, "  {:<10}  {}\n", "example", examples.join("; "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_command_is_in_one_group_and_every_example_is_one() {
        let command = crate::command();
        let shown = command.get_subcommands().filter(|command| !command.is_hide_set());
        let shown: BTreeSet<&str> = shown.map(Command::get_name).filter(|name| *name != "help").collect();
        let listed = || GROUPS.iter().flat_map(|group| group.commands.iter().copied());
        assert_eq!(listed().collect::<BTreeSet<_>>(), shown);
        assert_eq!(listed().count(), shown.len(), "each once");
        for example in GROUPS.iter().flat_map(|group| group.examples) {
            let parsed = command.clone().try_get_matches_from(example.split(' '));
            assert!(parsed.is_ok(), "{example}: {:?}", parsed.err().map(|error| error.to_string()));
        }
    }

    #[test]
    fn the_help_has_the_groups_and_the_options_of_all_commands_apart() {
        let help = crate::command().render_help().to_string();
        let at = |text: &str| help.find(text).unwrap_or_else(|| panic!("{text}: {help}"));
        assert!(at("Run:") < at("Operate:") && at("Develop:") < at("Options of all commands:"), "{help}");
        assert!(help.contains("  errors      Show the active faults"), "{help}");
        let mut command = crate::command();
        command.build();
        let plot = command.find_subcommand_mut("plot").unwrap().render_help().to_string();
        let own = plot.find("--out").unwrap();
        let common = plot.find("Options of all commands:").unwrap();
        assert!(own < common && common < plot.find("--lcm-url").unwrap(), "{plot}");
    }
}
