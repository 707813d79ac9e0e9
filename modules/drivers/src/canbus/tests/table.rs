//! Drives as files: the built-in ones are the drives of the data sheets, and what is wrong in a file is named.

use super::super::table::{BUILT_IN, DriveFile, built_in, parsed};
use super::super::tables::{BYTES_MAX, DriveTables, FILES_MAX};
use super::super::{Axis, BusConfig, Canbus, ConfigError, Drive, SteeringDrive, VelocityUnit, WheelKeys};
use super::{config, steering_of};
use canopen::drives::cia402::{Parameters, Table};
use canopen::drives::derive::{Reason, Refusal};
use canopen::drives::{epos, icla};
use canopen::master::Expect;
use settings::{Node, Problems, Table as Keys};
use std::path::Path;

/// A drive by its data sheet.
const SHEET: &str = "form = \"sheet\"\neds = \"wheel.eds\"\nvelocity_unit = \"rpm\"\nvendor = 5\n";

fn text(name: &str) -> &'static str {
    BUILT_IN.into_iter().find(|(own, _)| *own == name).unwrap().1
}

fn read(text: &str) -> Result<DriveFile, Vec<String>> {
    parsed(Path::new("drives/lift.toml"), text).map(|(_, file)| file)
}

fn objects(text: &str) -> Table {
    read(text).unwrap().objects("lift").unwrap().table
}

/// The EPOS with `from` replaced by `to` is refused with a line that contains this.
#[track_caller]
fn refused(from: &str, to: &str, expected: &str) {
    let epos = text("epos");
    assert!(epos.contains(from), "{from}");
    let lines = read(&epos.replacen(from, to, 1)).unwrap_err();
    assert!(lines.iter().any(|line| line.contains(expected)), "{lines:#?}, not {expected}");
    assert!(lines.iter().all(|line| line.starts_with("drives/lift.toml:")), "{lines:#?}");
}

#[test]
fn the_built_in_files_are_the_tables_of_the_drives() {
    assert_eq!(built_in("epos").unwrap().table, epos::TABLE);
    assert_eq!(built_in("icla").unwrap().table, icla::TABLE);
    assert_eq!(built_in("epos").unwrap().velocity_max, Some(epos::VELOCITY_MAX_RPM));
    assert!(built_in("lift").is_none());
}

/// What the master writes and compares at a boot-up is, to the last byte, what it was when both drives were code.
#[test]
fn their_boot_up_is_that_of_the_drives() {
    let parameters = |node| Parameters {
        node,
        velocity: 4321,
        acceleration: 1234,
        deceleration: 2345,
        quick_stop_deceleration: 3456,
        remap: false,
    };
    let of_file = built_in("epos").unwrap().table.node_config("propulsion", &parameters(1));
    assert_eq!(format!("{of_file:?}"), format!("{:?}", epos::node_config("propulsion", &parameters(1))));
    let of_file = built_in("icla").unwrap().table.node_config("steering", &parameters(2));
    assert_eq!(format!("{of_file:?}"), format!("{:?}", icla::node_config("steering", &parameters(2))));
}

#[test]
fn every_key_of_a_table_of_objects_reaches_it() {
    let more = "guarding = { period_s = 0.05, factor = 3 }\nwatches_master = false\nhomed_bit = 12\nrevision_min = 7\n\
                product = 9\nvendor = 0x0000_00FB";
    let file = text("epos").replace("vendor = 0x0000_00FB", more).replace("inhibit_s", "event_s = 0.5\ninhibit_s");
    let table = objects(&file.replace("number = 4", "number = 3\nadjust = true"));
    let guarding = table.guarding.unwrap();
    assert_eq!((guarding.period.as_millis(), guarding.factor, table.watches_master), (50, 3, false));
    assert_eq!(table.homed, 1 << 12);
    assert_eq!(table.identity[1..3], [Expect::equal(0x1018, 2, 9), Expect::at_least(0x1018, 3, 7)]);
    let tpdo = table.tpdos.last().unwrap();
    assert_eq!((tpdo.number, tpdo.adjust, tpdo.transmission.unwrap().event_timer), (3, true, Some(500)));
    let per_turn =
        |unit: &str| read(&text("epos").replace("\"rpm\"", unit)).unwrap().objects("lift").unwrap().units_per_turn;
    assert_eq!((per_turn("\"0.1 rpm\""), per_turn("\"0.001 rpm\"")), (600.0, 60_000.0));
    assert_eq!(per_turn("\"counts/s\"\ncounts_per_turn = 2000"), 2000.0);
}

#[test]
fn what_is_wrong_in_a_file_is_named_with_its_line() {
    refused("form = \"objects\"", "form = \"table\"", "form = \"table\": expected \"sheet\" or \"objects\"");
    refused("form = \"objects\"", "", "form: missing");
    refused("mode = ", "mod = ", "mod: unknown key, expected one of form, mode, ");
    refused("\"rpm\"", "\"stated\"", "velocity_unit = \"stated\": expected the unit itself");
    refused("\"rpm\"", "\"counts/s\"", "counts_per_turn: missing");
    refused("quick_stop_word = 0x0B", "quick_stop_word = 0x07", "quick_stop_word = 7: expected a controlword");
    refused("vendor = 0x0000_00FB", "", "vendor: missing");
    refused(
        "keeps_quick_stop",
        "watches_master = false\nkeeps_quick_stop",
        "watches_master = false: expected true, or",
    );
    refused("simulated = \"epos\"", "simulated = \"icla\"", "simulated = \"icla\": expected a drive of this mode");
    refused("keeps_quick_stop", "homing_method = 27\nkeeps_quick_stop", "homing_method = 27: expected nothing");
    refused("keeps_quick_stop", "gear = 0\nkeeps_quick_stop", "gear = 0: expected a number that is not 0");
    refused("equal = 0x6410", "", "identity[0].equal: missing, expected the value, or");
    refused("equal = 0x6410", "equal = 0x16410", "identity[0].equal = 91152: expected a value within the mask, 0xFFF0");
    refused("at_least = 0x2030", "at_least = 9\nat_most = 8", "identity[1].at_most = 8: expected at least at_least");
    refused("at_least = 0x2030", "equal = 9\nat_most = 8", "identity[1].equal = 9: expected nothing beside");
    refused("index = 0x607F", "index = 0x1400", "settings[0].index = 5120: expected 0x1029, or an object of");
    refused("index = 0x607F", "index = 0x60FF", "settings[0].index = 24831: expected 0x1029, or an object of");
    refused(
        "value = \"velocity\"",
        "value = \"fast\"",
        "settings[0].value = \"fast\": expected an integer, or \"velocity\"",
    );
    refused("value = \"velocity\"", "value = -1", "settings[0].value = -1: expected an integer from 0 to 4294967295");
    refused("value = \"quick stop\"", "value = 9", "settings = [4 items]: expected one with value = \"quick stop\"");
    refused("map = [0x6040_0010, 0x60FF_0020]", "map = [0x6040_0010]", "rpdo.map = [1 items]: expected 0x60400010 and");
    refused(
        "map = [0x6040_0010, 0x60FF_0020]",
        "map = [0x6040_0010, 0x60FF_0020, 0x6071_0010]",
        "rpdo.map = [3 items]: expected 0x60400010 and 0x60FF0020, and at most 0x60600008 beside them",
    );
    refused("map = [0x6041_0010]", "map = [0x6041_0011]", "tpdos[0].map = [1 items]: expected objects of whole bytes");
    refused("0x606C_0020", "0x6064_0020", "tpdos = [2 items]: expected one that maps the actual value, 0x606C0020");
    refused(
        "number = 4\nmap = [0x6041",
        "number = 1\nmap = [0x6041",
        "tpdos[1].number = 1: expected one that no other",
    );
    refused("transmission = 255\n", "", "tpdos[1].inhibit_s = 0.01: expected nothing without transmission");
    refused("unit = \"0.001\"", "unit = \"per mille\"", "motor[0].unit = \"per mille\": expected a part of A");
    refused("type = \"UNSIGNED16\"", "type = \"REAL32\"", "motor[0].type = \"REAL32\": expected \"INTEGER8\" or");
    let many = "[[settings]]\nindex = 0x2000\ntype = \"UNSIGNED8\"\nvalue = 1\n".repeat(61) + "[rpdo]";
    refused("[rpdo]", &many, "settings = [65 items]: expected at most 64 objects");
    let wrong = read(&SHEET.replace("eds = \"wheel.eds\"\n", "")).unwrap_err();
    assert_eq!(wrong, ["drives/lift.toml:1: eds: missing, expected a text"]);
    assert!(read("form = \"sheet\"\neds = [").unwrap_err()[0].starts_with("drives/lift.toml:2: "));
}

#[test]
fn a_table_that_could_not_stop_its_drive_or_moves_it_by_unknown_values_is_refused() {
    refused("transmission = 255", "transmission = 1", "tpdos[1].transmission = 1: expected an integer from 254 to 255");
    refused("inhibit_s = 0.01", "inhibit_s = 1", "tpdos[1].inhibit_s = 1: expected a number from 0 to 0.05");
    refused("index = 0x607F", "index = 0x60FE", "settings[0].index = 24830: expected 0x1029, or an object of");
    // The mode of the second axis of a device.
    refused("index = 0x607F", "index = 0x6860", "settings[0].index = 26720: expected 0x1029, or an object of");
    refused(
        "value = \"acceleration\"",
        "value = 5",
        "settings = [4 items]: expected one with value = \"acceleration\", or 0x6083 in stops_without",
    );
    let with = |index: &str, value: &str, expected: &str| {
        let more = format!("[[settings]]\nindex = {index}\ntype = \"INTEGER16\"\nvalue = {value}\n[rpdo]");
        refused("[rpdo]", &more, expected);
    };
    with("0x6085", "1", "settings[4].index = 24709: expected an object that is not set before");
    with("0x6085", "\"velocity\"", "settings[4].index = 24709: expected an object that is not set before");
    with(
        "0x6007",
        "0",
        "settings[4].value = 0: expected 3 or 1: a drive whose master is lost must brake, or 0x6007 in",
    );
    with("0x6007", "2", "settings[4].value = 2: expected 3 or 1");
    with("0x605A", "0", "settings[4].value = 0: expected a code with which the motor does not roll on");
    with("0x605E", "0", "settings[4].value = 0: expected a code with which the motor does not roll on");
    refused(
        "keeps_quick_stop",
        "stops_without = [0x6040]\nkeeps_quick_stop",
        "stops_without = [1 items]: expected indices of objects by which a drive stops",
    );
    refused(
        "keeps_quick_stop",
        "guarding = { factor = 3 }\nkeeps_quick_stop",
        "guarding.factor = 3: expected at most 0.2 s for period_s times factor",
    );
    let icla = text("icla");
    let product = "product = 0x4E30_3635\n";
    let identity = "[[identity]]\nindex = 0x6502\nmask = 0x21\nequal = 0x21\n";
    assert!(icla.contains(product) && icla.contains(identity));
    assert!(read(&icla.replace(product, "")).is_ok() && read(&icla.replace(identity, "")).is_ok());
    let wrong = read(&icla.replace(product, "").replace(identity, "")).unwrap_err();
    assert!(wrong[0].contains("product: missing, expected the product code, or an object in identity"), "{wrong:?}");
    let map = "map = [0x6040_0010, 0x607A_0020]";
    assert!(icla.contains(map));
    let wrong = read(&icla.replace(map, "map = [0x6040_0010, 0x607A_0020, 0x6060_0008]")).unwrap_err();
    assert!(wrong[0].contains("rpdo.map = [3 items]: expected 0x60400010 and 0x607A0020 alone"), "{wrong:?}");
    for bit in 9..=13 {
        let wrong = read(&icla.replace("homed_bit = 15", &format!("homed_bit = {bit}"))).unwrap_err();
        assert!(wrong[0].contains(&format!("homed_bit = {bit}: expected 8, 14 or 15")), "{wrong:?}");
    }
    // A steering would move at a speed that is stored in its drive.
    let wrong = read(&icla.replace("value = \"velocity\"", "value = 600")).unwrap_err();
    assert!(wrong[0].contains("expected one with value = \"velocity\", or 0x6081 in stops_without"), "{wrong:?}");
}

#[test]
fn a_ramp_that_its_object_cannot_hold_refuses_the_drive() {
    let of_ramp = |data_type: &str| format!("index = 0x6085\ntype = \"{data_type}\"");
    let epos_file = text("epos");
    assert!(epos_file.contains(&of_ramp("UNSIGNED32")));
    let narrow = epos_file.replace(&of_ramp("UNSIGNED32"), &of_ramp("UNSIGNED8"));
    let table = read(&narrow).unwrap().objects("lift").unwrap();
    let with = |quick_stop_deceleration| table.check(&Parameters { quick_stop_deceleration, ..epos::parameters(1) });
    assert_eq!(with(255), Ok(()));
    let reason = Reason::OutOfLimits { value: 256, low: 0, high: 255 };
    assert_eq!(with(256), Err(Refusal { index: 0x6085, sub: 0, reason }));
}

#[test]
fn a_steering_whose_positions_do_not_fit_is_refused() {
    let with = |counts_per_turn, gear| {
        let mut config = config();
        let table = built_in("icla").unwrap();
        steering_of(&mut config).drive = SteeringDrive::Table { table, gear, counts_per_turn, remap: false };
        Canbus::new(config).err()
    };
    assert!(with(1e6, -2000.0).is_none());
    let reason = Reason::OutOfLimits { value: 2_200_000_000, low: i32::MIN.into(), high: i32::MAX.into() };
    let refusal = Refusal { index: 0x607A, sub: 0, reason };
    assert_eq!(with(1e6, -2200.0), Some(ConfigError::Drive { axis: Axis::Steering, refusal }));
}

#[test]
fn a_data_sheet_lies_beside_the_file_that_names_it() {
    for eds in ["../wheel.eds", "sheets/../../wheel.eds", "/etc/wheel.eds"] {
        let expected = format!("drives/lift.toml:2: eds = {eds:?}: expected a data sheet beside this file");
        let wrong = read(&SHEET.replace("wheel.eds", eds)).unwrap_err();
        assert!(wrong.len() == 1 && wrong[0].starts_with(&expected), "{wrong:?}");
        refused("keeps_quick_stop", &format!("eds = {eds:?}\nkeeps_quick_stop"), &format!("eds = {eds:?}: expected"));
    }
    assert!(read(&SHEET.replace("wheel.eds", "sheets/wheel.eds")).is_ok());
}

#[test]
fn a_ramp_that_the_drive_does_not_need_may_be_left_out() {
    let epos = text("epos");
    let ramp = "[[settings]]\nindex = 0x6085\ntype = \"UNSIGNED32\"\nvalue = \"quick stop\"\n";
    assert!(epos.contains(ramp));
    let without = epos.replace(ramp, "");
    assert!(read(&without).is_err());
    assert!(read(&without.replace("keeps_quick", "stops_without = [0x6085]\nkeeps_quick")).is_ok());
}

/// Each file that the guide shows.
#[test]
fn the_files_of_the_guide_are_accepted() {
    let guide = include_str!("../../../../../docs/adding-a-drive.md");
    let blocks = guide.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next());
    let files: Vec<&str> = blocks.filter(|block| block.starts_with("# drives/")).collect();
    assert_eq!(files.len(), 2);
    for file in files {
        assert!(read(file).is_ok(), "{:?}", read(file));
    }
}

#[test]
fn an_rpdo_that_may_wait_for_sync_is_compared_at_the_boot_up() {
    let at_an_event = Expect::at_least(0x1403, 2, 254);
    let row = "{ id = 1, axis = \"propulsion\", driver = \"lift\", gear = 5 },";
    let is_compared = |file: &str| {
        let bus = nodes(&[("lift", file)], row).unwrap();
        let Drive::Wheel(WheelKeys { table: Some(table), .. }) = &bus.nodes[0].drive else { panic!("{bus:?}") };
        table.table.identity.contains(&at_an_event)
    };
    assert!(is_compared(text("epos")));
    // One that is set is read back.
    assert!(!is_compared(&text("epos").replacen("[rpdo]\n", "[rpdo]\ntransmission = 254\n", 1)));
    assert!(!built_in("epos").unwrap().table.identity.contains(&at_an_event));
}

/// Nodes of a bus with the tables of `files`, and what is refused.
fn nodes(files: &[(&str, &str)], nodes: &str) -> Result<BusConfig, Vec<String>> {
    let mut tables = DriveTables::default();
    for (name, text) in files {
        tables.add(name, Path::new(&format!("drives/{name}.toml")), text)?;
    }
    let mut robot = Node::parse(Path::new("robot.toml"), &format!("[can.main]\nnodes = [\n{nodes}\n]\n"))?;
    let problems = Problems::default();
    tables.expand(&mut robot, &problems);
    let bus = robot.below("can").and_then(|can| can.below("main")).unwrap();
    let mut config: BusConfig = Keys::root(bus, &problems).unwrap().whole();
    for (n, node) in config.nodes.iter_mut().enumerate() {
        tables.bind(&robot, "main", n, &mut node.drive);
    }
    let lines = problems.lines();
    if lines.is_empty() { Ok(config) } else { Err(lines) }
}

#[test]
fn a_node_has_the_keys_of_its_sheet_s_table_but_where_it_has_its_own() {
    let text = "form = \"sheet\"\neds = \"wheel.eds\"\ngear = 20\nvelocity_unit = \"0.1 rpm\"\nvendor = 5\n\
                revision_min = 3\nidentity = [{ index = 0x2003, mask = 0xF0, equal = 0x30 }]\n";
    let bus = nodes(&[("lift", text)], "{ id = 1, axis = \"left\", driver = \"lift\", gear = -26 }").unwrap();
    let Drive::Cia402(keys) = &bus.nodes[0].drive else { panic!("{:?}", bus.nodes) };
    assert_eq!((keys.gear, keys.velocity_unit), (Some(-26.0), VelocityUnit::TenthRpm));
    assert_eq!(bus.nodes[0].eds.as_deref(), Some(Path::new("drives/wheel.eds")));
    assert_eq!((keys.vendor, keys.revision_min, keys.identity.len()), (Some(5), Some(3), 1));
}

#[test]
fn a_node_has_the_objects_of_its_table_and_the_keys_of_its_axis() {
    let of_wheel = text("epos").replace("velocity_max", "gear = 5\neds = \"own.eds\"\nvelocity_max");
    let steering =
        text("icla").replace("keeps_quick_stop", "counts_per_turn = 2000\nhoming_method = 23\nkeeps_quick_stop");
    let rows = "{ id = 1, axis = \"propulsion\", driver = \"lift\" },\n\
                { id = 2, axis = \"steering\", driver = \"icla\", gear = 180, switch_rad = 0, \
                 homing_speed_radps = 0.2 },";
    let bus = nodes(&[("lift", &of_wheel), ("icla", &steering)], rows).unwrap();
    let (Drive::Wheel(wheel), Drive::Steering(steering)) = (&bus.nodes[0].drive, &bus.nodes[1].drive) else {
        panic!("{:?}", bus.nodes)
    };
    assert_eq!((wheel.gear, wheel.table.as_ref().unwrap().name.as_str()), (5.0, "lift"));
    assert_eq!(bus.nodes[0].eds.as_deref(), Some(Path::new("drives/own.eds")));
    assert_eq!((steering.counts_per_turn, steering.homing_method), (2000.0, 23));
    assert_eq!(
        steering.table.as_ref().unwrap().counts_per_turn,
        Some(2000.0),
        "that of the file, not the built-in one"
    );
}

#[test]
fn what_does_not_fit_is_named_where_it_is_written() {
    let node = |driver: &str| format!("{{ id = 1, axis = \"left\", driver = \"{driver}\" }}");
    let unknown = nodes(&[("lift", SHEET)], &node("lfit")).unwrap_err();
    let expected = "robot.toml:3: can.main.nodes[0].driver = \"lfit\": expected \"epos\" or \"icla\" or \"lift\" or \
                    \"cia402\" or \"odrive\" or \"vesc\", or the NAME of a file drives/NAME.toml";
    assert_eq!(unknown[0], expected);
    assert!(nodes(&[], &node("wheel:epos")).unwrap_err()[0].contains("driver = \"wheel:epos\": expected \"epos\" or"));
    let steers = nodes(&[("lift", text("icla"))], &node("lift")).unwrap_err();
    assert!(steers.iter().any(|line| line.contains("axis = \"left\": expected \"steering\"")), "{steers:?}");
    let steers = |bit: u8| {
        let keys = format!("gear = 180, switch_rad = 0, homing_speed_radps = 0.2, homed_bit = {bit}");
        nodes(&[], &format!("{{ id = 2, axis = \"steering\", driver = \"cia402\", eds = \"wheel.eds\", {keys} }}"))
    };
    assert_eq!([8, 14, 15].map(|bit| steers(bit).err()), [const { None }; 3]);
    assert!(steers(12).unwrap_err()[0].contains("homed_bit = 12: expected 8, 14 or 15"));
    // A key of the table that this axis refuses, in the file of the table.
    let homed = SHEET.to_owned() + "homing_method = 17\n";
    let refused = nodes(&[("lift", &homed)], &node("lift")).unwrap_err();
    let expected = "drives/lift.toml:5: nodes[0].homing_method = 17: expected nothing: a wheel is not homed";
    assert_eq!(refused, [expected]);
}

#[test]
fn names_sizes_and_numbers_of_files_are_bounded() {
    let add = |name: &str, text: &str| DriveTables::default().add(name, Path::new("drives/a.toml"), text);
    assert_eq!(add("lift-2_b", SHEET), Ok(()));
    for name in ["", "a b", "wheel:a", "../a", "ä", &"a".repeat(41)] {
        assert!(add(name, SHEET).unwrap_err()[0].contains("expected a name of at most 40 letters"), "{name}");
    }
    assert!(add("cia402", SHEET).unwrap_err()[0].contains("expected another name"));
    let long = SHEET.to_owned() + &"#".repeat(BYTES_MAX);
    assert_eq!(add("lift", &long).unwrap_err(), [format!("drives/a.toml: expected at most {BYTES_MAX} bytes")]);
    let mut tables = DriveTables::default();
    let added = (0..=FILES_MAX).map(|n| tables.add(&format!("a{n}"), Path::new("drives/a.toml"), SHEET));
    assert_eq!(added.filter(Result::is_ok).count(), FILES_MAX);
}

#[test]
fn a_file_in_place_of_a_built_in_one_is_remarked() {
    let mut tables = DriveTables::default();
    assert!(tables.remarks().is_empty());
    tables.add("epos", Path::new("drives/epos.toml"), text("epos")).unwrap();
    tables.add("lift", Path::new("drives/lift.toml"), SHEET).unwrap();
    assert_eq!(tables.remarks(), ["drives/epos.toml: replaces the built-in table \"epos\""]);
}

/// Whatever a file contains: a table that boots and packs, or lines of which each names the file.
#[test]
fn a_damaged_file_is_a_table_or_refused() {
    let mut seed = 1_u64;
    let mut random = move |below: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below
    };
    let inserts = ["0", "-1", "[", "]", "=", "\n", "\"", "{}", "[[rpdo]]\n", "1e300", "nan", "0xFFFFFFFF", "'''", "é"];
    let (mut tables, mut refusals) = (0, 0);
    for round in 0..4000 {
        let mut text: Vec<char> = [text("epos"), text("icla"), SHEET][round % 3].chars().collect();
        for _ in 0..=random(3) {
            let at = random(text.len().max(1));
            match random(4) {
                _ if at >= text.len() => {}
                0 => drop(text.remove(at)),
                1 => text[at] = char::from(32 + random(95) as u8),
                2 => text.truncate(at.max(1)),
                _ => drop(text.splice(at..at, inserts[random(inserts.len())].chars())),
            }
        }
        match read(&text.iter().collect::<String>()) {
            Ok(file) => {
                tables += 1;
                let Some(table) = file.objects("lift") else { continue };
                let parameters = epos::parameters(1);
                assert!(!table.table.node_config("a", &parameters).mappings.is_empty());
                assert!(!table.table.pack(0x0F, i32::MIN).is_empty());
                for number in 0..=255 {
                    let _ = table.table.unpack(number, &[0xFF; 8]);
                }
            }
            Err(lines) => {
                refusals += 1;
                let are_named = |line: &String| line.starts_with("drives/lift.toml:") && !line.contains('\n');
                assert!(!lines.is_empty() && lines.iter().all(are_named), "{lines:?}");
            }
        }
    }
    assert!(tables > 100 && refusals > 100, "{tables} tables, {refusals} refusals");
    assert!(read("").is_err());
    let deep = format!("form = {}1{}", "[".repeat(20_000), "]".repeat(20_000));
    assert!(read(&deep).is_err());
}
