//! docs/writing-a-module.md: what it shows is what there is.

use crate::milestones::Milestones;
use crate::support::workspace;
use messages::lowlevel::DataOdo;
use module::bench::Bench;
use module::{Action, Shell, ShellConfig, State};
use robot::config::Config;
use std::fs;

fn page() -> String {
    fs::read_to_string(workspace().join("docs/writing-a-module.md")).expect("the page")
}

/// The text of the fenced block of that language.
fn block(page: &str, language: &str) -> String {
    let from = page.split_once(&format!("```{language}\n")).expect("there is one").1;
    from.split_once("```").expect("it ends").0.into()
}

#[test]
fn the_entries_that_the_page_shows_are_accepted() {
    let config = std::env::temp_dir().join(format!("advee-page-{}", std::process::id()));
    fs::create_dir_all(&config).unwrap();
    let shipped = workspace().join("conf/advee");
    for name in ["robot.toml", "sim.toml"] {
        fs::copy(shipped.join(name), config.join(name)).unwrap();
    }
    let modules = fs::read_to_string(shipped.join("modules.toml")).unwrap() + &block(&page(), "toml");
    fs::write(config.join("modules.toml"), modules).unwrap();
    let read = Config::load(&config, true, &[]);
    fs::remove_dir_all(&config).unwrap();
    let modules = read.unwrap().modules;
    for (name, file) in [("battery_watch", "python/battery_watch.py"), ("nearest_obstacle", "cpp/nearest_obstacle")] {
        let entry = modules.iter().find(|module| module.name() == name).unwrap();
        let line = [entry.command.clone().unwrap_or_default(), entry.args.join(" ")].join(" ");
        assert!(line.contains(&format!("examples/modules/{file}")), "{line}");
    }
}

#[test]
fn the_module_in_rust_that_the_page_shows_is_one() {
    let text = include_str!("milestones.rs");
    assert_eq!(block(&page(), "rust"), text);

    let mut bench = Bench::new(Shell::new(ShellConfig::new("milestones"), Box::new(Milestones::default())));
    bench.start();
    assert_eq!(bench.shell.state(), State::Init);
    let mut notes = Vec::new();
    for path in 0..250 {
        bench.message(DataOdo { path: f64::from(path), ..DataOdo::default() });
        notes.extend(bench.done().into_iter().filter_map(|(_, action)| match action {
            Action::Note(_, line) => Some(line),
            _ => None,
        }));
    }
    assert_eq!(bench.shell.state(), State::Run);
    assert_eq!(notes, ["100 m driven", "200 m driven"]);
}
