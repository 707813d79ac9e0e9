//! `advee world map`: a world of the simulation as a map file of nav2.

use super::{Common, Outcome, print};
use planner::map::Cell;
use robot::{config, map_file};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Subcommand)]
pub enum Command {
    /// Write what a robot can reach in a world as a map: YAML and PGM as nav2's map_server reads them, cells of 0.05 m
    #[command(after_help = EXAMPLES)]
    Map(Map),
}

#[derive(clap::Args)]
pub struct Map {
    /// The world: a file, or a name in conf/worlds [default: hall]
    #[arg(long, value_name = "NAME")]
    world: Option<PathBuf>,
    /// The map's text, which ends in .yaml; its picture is written beside it
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
}

const EXAMPLES: &str = "Examples:
  advee world map --world hall -o hall.yaml  its walls, columns and drops as hall.yaml and hall.pgm
  advee up --sim --world hall.yaml           a map is a world, too";

pub fn world(common: &Common, command: &Command) -> Outcome {
    let Command::Map(Map { world, out }) = command;
    let path = config::world_place(&common.config_dir(), world.as_deref());
    let read = config::world(&common.config_dir(), world.as_deref(), &common.sets)?;
    let map = map_file::of_rooms(&read).map_err(|error| format!("{}: {error}", path.display()))?;
    map_file::save(&map, out)?;
    let count = |cell| map.cells().iter().filter(|other| **other == cell).count();
    print(format_args!(
        "{}: {}, {} cells free, {} occupied, {} unknown",
        out.display(),
        map.frame().extent(),
        count(Cell::Free),
        count(Cell::Occupied),
        count(Cell::Unknown)
    ))?;
    Ok(ExitCode::SUCCESS)
}
