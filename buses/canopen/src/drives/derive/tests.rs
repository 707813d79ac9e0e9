//! Sheets with one thing changed: what is refused, and with which object; units; PDOs; hostile sheets.

use super::*;
use crate::drives::motor::{Own, Topic, Unit};
use crate::drives::{epos, icla};
use crate::master::{Master, MasterConfig};
use crate::pdo::INVALID;
use ::testing::Random;
use base::Duration;
use std::string::{String, ToString};
use std::{assert_eq, format, vec};

const NODE: u8 = 5;
const GENERIC: &str = include_str!("../../../eds/others/ros2_cia402_slave.eds");
const ICLA: &str = include_str!("../../../eds/icla_sim.eds");
const EPOS: &str = include_str!("../../../eds/epos_sim.eds");
const EPOS4: &[u8] = include_bytes!("../../../eds/others/maxon_epos4_50_15_node1.dcf");

fn wheel() -> Description {
    Description {
        mode: Mode::ProfileVelocity,
        per_turn: 0.5,
        gear: Some(20.0),
        counts_per_turn: None,
        velocity_unit: Some(VelocityUnit::Rpm),
        limits: Limits { velocity: 1.0, acceleration: 1.0, deceleration: 1.0, quick_stop: 2.0 },
        range: None,
        homing: None,
        sync: None,
        setpoints: None,
        master: 127,
        torque: false,
        second_way: false,
        quirks: Quirks::default(),
    }
}

fn steering() -> Description {
    Description { mode: Mode::ProfilePosition, counts_per_turn: Some(4096), homing: Some(27), ..wheel() }
}

/// Begin and end of a section.
fn section(text: &str, name: &str) -> core::ops::Range<usize> {
    let begin = text.find(&format!("[{name}]")).unwrap_or_else(|| panic!("no section {name}"));
    let end = text[begin + 1..].find("\n[").map_or(text.len(), |end| begin + end + 2);
    begin..end
}

/// Without an index and all below it.
fn without(text: &str, index: &str) -> String {
    let mut text = text.to_string();
    let names: Vec<String> = (0..=255).map(|sub| format!("{index}sub{sub:X}")).chain([index.to_string()]).collect();
    for name in
        names.iter().filter(|name| GENERIC.contains(&format!("[{name}]")) || ICLA.contains(&format!("[{name}]")))
    {
        if text.contains(&format!("[{name}]")) {
            text.replace_range(section(&text, name), "");
        }
    }
    text
}

/// With a key of a section set.
fn with(text: &str, name: &str, key: &str, value: &str) -> String {
    let range = section(text, name);
    let lines = text[range.clone()].lines().filter(|line| !line.starts_with(&format!("{key}=")));
    let changed = lines.fold(String::new(), |all, line| all + line + "\n") + &format!("{key}={value}\n");
    let mut text = text.to_string();
    text.replace_range(range, &changed);
    text
}

fn read(text: &str) -> Eds {
    Eds::parse(text.as_bytes()).unwrap()
}

fn derived(text: &str, description: &Description) -> Result<Derived, Refusal> {
    derive(&read(text), NODE, description)
}

/// Value that is written to an object at boot-up.
fn written(derived: &Derived, index: u16, sub: u8) -> Option<u32> {
    let node = derived.table.node_config("drive", &derived.parameters);
    let write = node.writes.iter().rfind(|write| (write.index, write.sub) == (index, sub));
    write.and_then(|write| write.value.bits())
}

#[test]
fn what_a_drive_must_have_to_stop_is_refused_by_object_or_left_to_the_second_way() {
    let cases = [
        (without(GENERIC, "605A"), 0x605A, 0, Reason::Missing),
        (with(&with(GENERIC, "605A", "AccessType", "ro"), "605A", "DefaultValue", "0"), 0x605A, 0, Reason::RollsOn(0)),
        (with(GENERIC, "605E", "DefaultValue", "0"), 0x605E, 0, Reason::RollsOn(0)),
        (without(GENERIC, "605E"), 0x605E, 0, Reason::Missing),
        (without(GENERIC, "6084"), 0x6084, 0, Reason::Missing),
        (with(GENERIC, "6085", "AccessType", "ro"), 0x6085, 0, Reason::NotWritable),
        (without(&without(&without(GENERIC, "1016"), "100C"), "100D"), 0x1016, 1, Reason::Missing),
        (without(GENERIC, "1029"), 0x6007, 0, Reason::Missing),
        (with(&with(ICLA, "6007", "AccessType", "ro"), "6007", "DefaultValue", "0"), 0x6007, 0, Reason::RollsOn(0)),
        (with(&with(ICLA, "6007", "AccessType", "ro"), "6007", "DefaultValue", "2"), 0x6007, 0, Reason::RollsOn(2)),
    ];
    for (text, index, sub, reason) in cases {
        let refusal = Refusal { index, sub, reason };
        assert_eq!(derived(&text, &wheel()).unwrap_err(), refusal);
        let by_second_way = derived(&text, &Description { second_way: true, ..wheel() }).unwrap();
        assert_eq!(by_second_way.reservations, [refusal], "{refusal}");
        let quirks = Quirks { vouched: [index].into(), ..Quirks::default() };
        let vouched = derived(&text, &Description { quirks, ..wheel() }).unwrap();
        assert_eq!(vouched.reservations, [], "{refusal}");
    }
    assert_eq!(derived(GENERIC, &wheel()).unwrap().reservations, []);
}

#[test]
fn what_no_second_way_replaces_is_refused_always() {
    let unheard = without(&without(&without(GENERIC, "1017"), "100C"), "100D");
    let heard = with(&with(GENERIC, "1016sub1", "HighLimit", "0x10000"), "100C", "AccessType", "ro");
    let high = i64::from(0x7F_00C8);
    for (text, description, index, sub, reason) in [
        (without(GENERIC, "6060"), wheel(), 0x6060, 0, Reason::Missing),
        (without(GENERIC, "6061"), wheel(), 0x6061, 0, Reason::Missing),
        (without(GENERIC, "60FF"), wheel(), 0x60FF, 0, Reason::Missing),
        (with(GENERIC, "606C", "DataType", "0x0003"), wheel(), 0x606C, 0, Reason::Type),
        (with(GENERIC, "1000", "DefaultValue", "0x00020191"), wheel(), 0x1000, 0, Reason::Profile(401)),
        (unheard, wheel(), 0x1017, 0, Reason::Missing),
        (
            with(GENERIC, "6084", "HighLimit", "100"),
            wheel(),
            0x6084,
            0,
            Reason::OutOfLimits { value: 2400, low: 0, high: 100 },
        ),
        (
            with(GENERIC, "6502", "DefaultValue", "0x21"),
            wheel(),
            0x6502,
            0,
            Reason::Mode { wanted: Mode::ProfileVelocity, offered: 0x21 },
        ),
        (
            with(GENERIC, "6502", "DefaultValue", "0x05"),
            steering(),
            0x6502,
            0,
            Reason::Mode { wanted: Mode::Homing, offered: 5 },
        ),
        (
            with(GENERIC, "6098", "HighLimit", "26"),
            steering(),
            0x6098,
            0,
            Reason::OutOfLimits { value: 27, low: -128, high: 26 },
        ),
        (without(GENERIC, "6099"), steering(), 0x6099, 1, Reason::Missing),
        (GENERIC.into(), Description { velocity_unit: None, ..wheel() }, 0x608F, 1, Reason::NoUnit),
        (without(GENERIC, "608F"), Description { velocity_unit: None, ..wheel() }, 0x60A9, 0, Reason::NoUnit),
        (GENERIC.into(), Description { gear: None, ..wheel() }, 0x6091, 1, Reason::NoUnit),
        (GENERIC.into(), Description { gear: Some(0.0), ..wheel() }, 0x6091, 1, Reason::NoUnit),
        (GENERIC.into(), Description { per_turn: f64::NAN, ..wheel() }, 0x6091, 1, Reason::NoUnit),
        (
            GENERIC.into(),
            Description { mode: Mode::Velocity, ..wheel() },
            0x6502,
            0,
            Reason::Mode { wanted: Mode::Velocity, offered: 0xA5 },
        ),
    ] {
        let description = Description { second_way: true, ..description };
        assert_eq!(derived(&text, &description).unwrap_err(), Refusal { index, sub, reason });
    }
    // A limit that forbids any heartbeat of a master: only another way to stop helps.
    let refusal = derived(&heard, &wheel()).unwrap_err();
    assert_eq!((refusal.index, refusal.reason), (0x1016, Reason::OutOfLimits { value: high, low: 0, high: 0x10000 }));
    assert!(derived(&heard, &Description { second_way: true, ..wheel() }).is_ok());
}

#[test]
fn a_refusal_names_the_object_in_words() {
    let refusal = derived(&with(GENERIC, "6502", "DefaultValue", "0x21"), &wheel()).unwrap_err();
    let words =
        "0x6502:0 (supported modes): the drive cannot be driven in profile velocity; it has profile position, homing";
    assert_eq!(refusal.to_string(), words);
}

#[test]
fn modes_follow_from_the_objects_where_the_sheet_states_none() {
    let text = without(GENERIC, "6502");
    let modes = derived(&text, &wheel()).unwrap().modes;
    assert_eq!(modes[..3], [Mode::ProfilePosition, Mode::ProfileVelocity, Mode::Homing]);
    let refusal = derived(&without(&text, "60FF"), &wheel()).unwrap_err();
    assert!(matches!(refusal.reason, Reason::Mode { wanted: Mode::ProfileVelocity, .. }));
}

#[test]
fn units_are_exact_and_what_they_rest_on_is_compared_at_boot_up() {
    let parts = |ratio: Ratio| ratio.parts();
    let usual = Description { velocity_unit: None, ..wheel() };
    let epos4 = derive(&Eds::parse(EPOS4).unwrap(), 1, &usual).unwrap();
    assert_eq!((parts(epos4.scale.velocity), parts(epos4.scale.acceleration)), ((60, 1), (60, 1)));
    assert!(epos4.table.identity.contains(&Expect::equal(0x60A9, 0, 0x00B4_4700)));
    assert_eq!(epos4.units.velocity(1.0), 2400, "40 turns of the motor per metre");

    // 10 000 increments on 3 turns.
    let encoder = with(&with(GENERIC, "608Fsub1", "DefaultValue", "10000"), "608Fsub2", "DefaultValue", "3");
    let scale = derived(&encoder, &usual).unwrap();
    assert_eq!((scale.scale.position.map(parts), parts(scale.scale.velocity)), (Some((10_000, 3)), (10_000, 3)));
    assert_eq!(scale.units.velocity(1.0), 133_333);
    assert!(scale.table.identity.contains(&Expect::equal(0x608F, 1, 10_000)));
    assert_eq!(written(&scale, 0x6083, 0), Some(133_333));

    // A feed of 1000 units per turn of a shaft behind a gear of 7 : 2, which is the gear of the axis, too.
    let factor = |index: &str, above: u32, below: u32| {
        let part = |sub, value| {
            format!(
                "[{index}sub{sub}]\nParameterName=x\nObjectType=7\nDataType=7\nAccessType=ro\nDefaultValue={value}\n"
            )
        };
        format!("[{index}]\nParameterName=x\nObjectType=8\nSubNumber=3\n{}{}", part(1, above), part(2, below))
    };
    let feed = encoder + &factor("6091", 7, 2) + &factor("6092", 1000, 1);
    let scale = derived(&feed, &Description { gear: None, ..usual.clone() }).unwrap();
    assert_eq!(scale.scale.position.map(parts), Some((2000, 7)));
    assert_eq!(scale.units.velocity(0.5), 1000, "a turn of the output");

    for (unit, per_turn) in [(VelocityUnit::Rpm, 60), (VelocityUnit::TenthRpm, 600), (VelocityUnit::MilliRpm, 60_000)] {
        let scale = derived(GENERIC, &Description { velocity_unit: Some(unit), ..wheel() }).unwrap().scale;
        assert_eq!((parts(scale.velocity), scale.position), ((per_turn, 1), None));
    }
    let counts =
        Description { counts_per_turn: Some(512), velocity_unit: Some(VelocityUnit::CountsPerSecond), ..wheel() };
    assert_eq!(parts(derived(GENERIC, &counts).unwrap().scale.velocity), (512, 1));
    assert_eq!([Ratio::new(0, 1), Ratio::new(1, 0)], [None, None]);
}

#[test]
fn the_greatest_velocity_has_a_margin_as_far_as_the_drive_takes_it() {
    let limited = |high| with(&without(ICLA, "607E"), "607F", "HighLimit", high);
    let greatest = |high| derived(&limited(high), &wheel()).map(|derived| written(&derived, 0x607F, 0).unwrap());
    assert_eq!([greatest("5000"), greatest("2500")], [Ok(2640), Ok(2500)]);
    let reason = Reason::OutOfLimits { value: 2400, low: 1, high: 2000 };
    assert_eq!(greatest("2000"), Err(Refusal { index: 0x607F, sub: 0, reason }));
}

#[test]
fn pdos_are_taken_as_they_are_or_mapped_anew_and_the_others_are_off() {
    let as_it_is = derived(GENERIC, &wheel()).unwrap();
    let numbers = |derived: &Derived| (derived.table.rpdo.number, derived.table.tpdos[0].number);
    assert_eq!(numbers(&as_it_is), (4, 4));
    // TPDO1 to 3 of a new drive are on, at SYNC.
    let off = [0x1800, 0x1801, 0x1802].map(|record| written(&as_it_is, record, 1).map(|id| id & INVALID != 0));
    assert_eq!((off, written(&as_it_is, 0x1803, 1)), ([Some(true); 3], Some(0x4000_0485)));
    assert_eq!((written(&as_it_is, 0x1803, 2), written(&as_it_is, 0x1403, 2)), (Some(255), Some(255)));
    // The boot-up switches off whatever RPDO the sheet lists.
    let further = "\n[1414]\nParameterName=x\nObjectType=9\nSubNumber=2\n".to_string()
        + "[1414sub1]\nParameterName=x\nObjectType=7\nDataType=7\nAccessType=rw\n";
    let further = derived(&(GENERIC.to_string() + &further), &wheel()).unwrap();
    let node = further.table.node_config("drive", &further.parameters);
    assert_eq!((node.only_mapped_rpdos, &node.rpdos[..]), (true, &[0x1400, 0x1401, 0x1402, 0x1403, 0x1414][..]));

    // Another one maps it nowhere: the first PDO is changed.
    let nowhere = with(&with(GENERIC, "1603sub2", "DefaultValue", "0"), "1A03sub2", "DefaultValue", "0");
    let anew = derived(&nowhere, &wheel()).unwrap();
    assert_eq!((numbers(&anew), anew.table.rpdo.adjust), ((1, 1), true));
    assert_eq!(anew.table.rpdo.entries[..], [0x6040_0010, 0x60FF_0020]);
    let fixed = |text: &str, kind: &str| {
        (0..4).fold(text.to_string(), |text, n| with(&text, &format!("{kind}{n}sub0"), "AccessType", "ro"))
    };
    for (kind, index) in [("160", 0x1600), ("1A0", 0x1A00)] {
        let refusal = derived(&fixed(&nowhere, kind), &wheel()).unwrap_err();
        assert_eq!(refusal, Refusal { index, sub: 0, reason: Reason::NoPdo });
    }
    let refusal = derived(&with(&nowhere, "60FF", "PDOMapping", "0"), &wheel()).unwrap_err();
    assert_eq!(refusal, Refusal { index: 0x60FF, sub: 0, reason: Reason::NotMappable });

    // Two TPDOs that cannot be changed: one has the statusword, the other one the velocity.
    let apart =
        fixed(&with(&with(&nowhere, "1A03sub1", "DefaultValue", "0x606C0020"), "1A03sub0", "DefaultValue", "1"), "1A0");
    let pair = derived(&apart, &wheel()).unwrap();
    assert_eq!(pair.table.tpdos.iter().map(|pdo| pdo.number).collect::<Vec<_>>(), [1, 4]);
    let status = [pair.table.unpack(1, &[0x37, 0x02]), pair.table.unpack(4, &[0xFE, 0xFF, 0xFF, 0xFF])];
    let status = status.map(|status| status.map(|status| (status.statusword, status.value)));
    assert_eq!(status, [Some((Some(0x237), None)), Some((None, Some(-2)))]);
}

/// With a torque, and its rated value.
fn with_torque() -> String {
    let object = |index, name, kind, access, mapping| {
        let head = format!("\n[{index}]\nParameterName={name}\nObjectType=0x7\nDataType=0x{kind}\n");
        head + &format!("AccessType={access}\nDefaultValue=0\nPDOMapping={mapping}\n")
    };
    GENERIC.to_string()
        + &object("6076", "Motor rated torque", "0007", "ro", 0)
        + &object("6077", "Torque actual value", "0003", "ro", 1)
}

#[test]
fn a_torque_that_is_wanted_gets_a_tpdo_of_its_own_that_is_sent_in_a_period() {
    let wanted = Description { torque: true, ..wheel() };
    let numbers = |derived: &Derived| derived.table.tpdos.iter().map(|pdo| pdo.number).collect::<Vec<_>>();
    let both = derived(&with_torque(), &wanted).unwrap();
    assert_eq!((numbers(&both), both.table.reports_torque()), ([4, 1].into(), true));
    assert_eq!(both.table.tpdos[1].entries[..], [0x6077_0010]);
    let of_record = [2, 3, 5, 1].map(|sub| written(&both, 0x1800, sub));
    assert_eq!(of_record, [Some(255), Some(200), Some(20), Some(0x4000_0185)]);
    // 20 turns of the motor in 0.5 m.
    assert_eq!(both.turns, 40.0);
    let unpacked = |number, data: &[u8]| both.table.unpack(number, data).map(|status| (status.torque, status.value));
    assert_eq!(unpacked(1, &[0x00, 0x80]), Some((Some(i16::MIN), None)));
    assert_eq!((unpacked(1, &[0xFF, 0x7F]), unpacked(1, &[1])), (Some((Some(i16::MAX), None)), None));
    assert_eq!(unpacked(4, &[0x37, 0x02, 5, 0, 0, 0]), Some((None, Some(5))));

    // One that has it already is taken as it is.
    let mapped = with(&with(&with_torque(), "1A01sub1", "DefaultValue", "0x60770010"), "1A01sub0", "DefaultValue", "1");
    assert_eq!(numbers(&derived(&mapped, &wanted).unwrap()), [4, 2]);
    // This drive has no event timer.
    let eds = Eds::parse(EPOS4).unwrap();
    let epos4 = derive(&eds, NODE, &Description { velocity_unit: None, ..wanted.clone() }).unwrap();
    assert_eq!((numbers(&epos4), epos4.table.reports_torque()), ([1, 2].into(), true));
    assert_eq!((written(&epos4, 0x1801, 3), written(&epos4, 0x1801, 5)), (Some(200), None));
}

#[test]
fn a_drive_without_a_torque_or_a_tpdo_for_it_is_driven_as_one_of_which_none_is_wanted() {
    let wanted = Description { torque: true, ..wheel() };
    let fixed = |key: &str| {
        (0..3).fold(with_torque(), |text, number| with(&text, &format!("180{number}{key}"), "AccessType", "ro"))
    };
    for text in [
        GENERIC.to_string(),
        without(&with_torque(), "6076").replace("[6076]", "[6A76]"),
        with(&with_torque(), "6077", "DataType", "0x0004"),
        with(&with_torque(), "6077", "PDOMapping", "0"),
        with(&with_torque(), "6077", "AccessType", "wo"),
        fixed("sub2"),
        fixed("sub3"),
    ] {
        let (one, other) = (derived(&text, &wanted).unwrap(), derived(&text, &wheel()).unwrap());
        assert_eq!(one.table, other.table);
        assert!(!one.table.reports_torque());
    }
    let not_wanted = derived(&with_torque(), &wheel()).unwrap();
    assert!(!not_wanted.table.reports_torque());
}

#[test]
fn a_mode_and_gaps_in_an_rpdo_are_filled() {
    let entries = [("1", "0x00050008"), ("2", "0x60FF0020"), ("3", "0x60400010")];
    let text = entries
        .iter()
        .fold(GENERIC.to_string(), |text, (sub, entry)| with(&text, &format!("1603sub{sub}"), "DefaultValue", entry));
    let text = with(&text, "1603sub0", "DefaultValue", "3");
    let table = derived(&text, &wheel()).unwrap().table;
    assert_eq!(table.pack(0x0F, -2)[..], [0, 0xFE, 0xFF, 0xFF, 0xFF, 0x0F, 0]);
    let text = with(&text, "1603sub1", "DefaultValue", "0x60600008");
    let table = derived(&text, &wheel()).unwrap().table;
    assert_eq!(table.pack(0x0F, 1)[..], [3, 1, 0, 0, 0, 0x0F, 0]);
}

#[test]
fn identity_is_that_of_the_sheet_or_of_the_quirks() {
    let derived_with = |identity: &[Expect]| {
        let quirks = Quirks { identity: identity.into(), ..Quirks::default() };
        derived(GENERIC, &Description { quirks, ..wheel() }).unwrap().table.identity
    };
    let vendor = Expect::equal(0x1018, 1, 0x555);
    assert!(derived_with(&[]).contains(&vendor) && derived_with(&[]).contains(&Expect::masked(0x1000, 0, 0xFFFF, 402)));
    let other = Expect::equal(0x1018, 1, 7);
    assert!(derived_with(&[other]).contains(&other) && !derived_with(&[other]).contains(&vendor));
    // A further object is compared beside that of the sheet.
    let further = Expect::at_least(0x2003, 1, 7);
    assert!([further, vendor].iter().all(|expect| derived_with(&[further]).contains(expect)));
}

#[test]
fn homing_methods_are_those_that_the_sheet_lists() {
    let eds = Eds::parse(EPOS4).unwrap();
    let with = |homing| derive(&eds, 1, &Description { homing, ..steering() });
    let methods = with(None).unwrap().methods.unwrap();
    assert_eq!((methods.len(), methods.contains(&-4), methods.contains(&24)), (15, true, false));
    assert_eq!(with(Some(24)).unwrap_err(), Refusal { index: 0x60E3, sub: 0, reason: Reason::Method(24) });
    // This drive has its home offset elsewhere.
    assert_eq!(with(Some(-4)).unwrap_err(), Refusal { index: 0x607C, sub: 0, reason: Reason::Missing });
    assert_eq!(derived(GENERIC, &steering()).unwrap().methods, None);
}

/// The tables that are written by hand say nothing that their sheets, with the quirks, do not say.
#[test]
fn the_drives_of_the_robot_follow_from_their_sheets() {
    let quirks = Quirks {
        quick_stop: Some(epos::TABLE.quick_stop),
        keeps_quick_stop: true,
        vouched: [0x605A, 0x605E, 0x6007].into(),
        identity: epos::TABLE.identity.to_vec(),
        ..Quirks::default()
    };
    let epos = derived(EPOS, &Description { quirks, ..wheel() }).unwrap();
    let quirks = Quirks { homed: icla::HOMED, identity: icla::TABLE.identity.to_vec(), ..Quirks::default() };
    let icla = derived(ICLA, &Description { quirks, ..steering() }).unwrap();
    for (derived, table) in [(&epos, &epos::TABLE), (&icla, &icla::TABLE)] {
        let ours = &derived.table;
        assert!(table.settings.iter().all(|setting| ours.settings.contains(setting)), "{:?}", ours.settings);
        assert!(table.identity.iter().all(|expect| ours.identity.contains(expect)));
        assert_eq!((ours.rpdo.number, &ours.rpdo.entries), (table.rpdo.number, &table.rpdo.entries));
        assert_eq!((ours.tpdos[0].number, &ours.tpdos[0].entries), (table.tpdos[1].number, &table.tpdos[1].entries));
        assert_eq!(ours.tpdos[0].transmission, table.tpdos[1].transmission);
        assert_eq!((ours.quick_stop, ours.keeps_quick_stop), (table.quick_stop, table.keeps_quick_stop));
        assert_eq!((ours.homed, ours.watches_master, ours.guarding), (table.homed, table.watches_master, None));
        assert!(derived.reservations.is_empty());
    }
}

/// Whatever a sheet says: a refusal, or a table that a master takes.
#[test]
fn a_thousand_hostile_sheets_make_no_panic() {
    let mut random = Random::new(402);
    let (mut read, mut taken) = (0, 0);
    for round in 0..1000 {
        let mut file = [GENERIC.as_bytes(), ICLA.as_bytes(), EPOS.as_bytes(), EPOS4][round % 4].to_vec();
        for _ in 0..=random.below(6) {
            let at = random.below(file.len() as u64) as usize;
            match random.below(6) {
                0 => file[at] = random.below(256) as u8,
                1 => file[at] = b"0123456789ABCDEFx-$"[random.below(19) as usize],
                // A line is lost, a line is doubled.
                2 | 3 => {
                    let end = file[at..].iter().position(|byte| *byte == b'\n').map_or(file.len(), |end| at + end + 1);
                    let line = file[at..end].to_vec();
                    let lost = random.below(2) == 0;
                    drop(file.splice(at..end, if lost { Vec::new() } else { [line.clone(), line].concat() }));
                }
                // A value is another one.
                4 => {
                    let equals = file[at..].iter().position(|byte| *byte == b'=').map(|found| at + found + 1);
                    let words = ["0", "0xFFFFFFFF", "-2147483648", "ro", "wo", "7", "0x60FF0040", "64", ""];
                    let word = words[random.below(words.len() as u64) as usize];
                    if let Some(from) = equals {
                        let end = file[from..].iter().position(|byte| *byte == b'\n').map_or(file.len(), |n| from + n);
                        drop(file.splice(from..end, word.bytes()));
                    }
                }
                _ => file.truncate(file.len() - (random.below(file.len() as u64 / 50 + 1) as usize)),
            }
        }
        let Ok(eds) = Eds::parse(&file) else { continue };
        read += 1;
        let cyclic = |mode, usual| Description { mode, setpoints: Some(Duration::from_millis(20)), ..usual };
        for description in [
            wheel(),
            steering(),
            Description { velocity_unit: None, gear: None, ..wheel() },
            cyclic(Mode::CyclicVelocity, wheel()),
            cyclic(Mode::CyclicPosition, steering()),
            cyclic(Mode::Interpolated, steering()),
        ] {
            let description = Description {
                torque: true,
                second_way: random.below(2) == 0,
                sync: Some(Duration::from_millis(10)),
                homing: description.homing.filter(|_| random.below(2) == 0),
                ..description
            };
            let Ok(derived) = derive(&eds, random.below(256) as u8, &description) else { continue };
            taken += 1;
            let node = derived.table.node_config("drive", &derived.parameters);
            assert!(node.writes.len() < 100 && node.identity.len() < 50);
            assert!(derived.table.pack(u16::MAX, i32::MIN).len() <= 8);
            for number in 0..=5 {
                for len in 0..=8 {
                    let _ = derived.table.unpack(number, &[0xA5; 8][..len]);
                }
            }
            let config = MasterConfig { id: if node.id == 127 { 1 } else { 127 }, ..MasterConfig::default() };
            Master::new(config, &[node]).unwrap();
        }
    }
    assert!(read > 300 && taken > 200, "{read} were read, {taken} taken");
}

#[test]
fn current_torque_and_temperature_are_read_where_the_sheet_or_the_manual_has_them() {
    let read = |sheet: &[u8], quirks: Quirks| {
        let eds = Eds::parse(sheet).unwrap();
        let derived = derive(&eds, NODE, &Description { quirks, velocity_unit: None, ..wheel() })?;
        Ok::<_, Refusal>(derived.table.motor.iter().map(|own| (own.topic, own.index, own.sub)).collect::<Vec<_>>())
    };
    // Torque alone is CiA 402's in it; its current and its temperature are maxon's own.
    let torque = [(Topic::RatedTorque, 0x6076, 0), (Topic::Torque, 0x6077, 0)];
    assert_eq!(read(EPOS4, Quirks::default()), Ok(torque.to_vec()));
    let current = Own { index: 0x30D1, sub: 2, unit: Unit::Decimal(-3) };
    let temperature = Own { index: 0x3201, sub: 1, unit: Unit::Decimal(-1) };
    let named = Quirks { current: Some(current), temperature: Some(temperature), ..Quirks::default() };
    let own = [(Topic::Current, 0x30D1, 2), torque[1], (Topic::Temperature, 0x3201, 1)];
    assert_eq!(read(EPOS4, named.clone()), Ok([&torque[..1], &own].concat()));
    let absent = Quirks { temperature: Some(Own { index: 0x3299, ..temperature }), ..named };
    assert_eq!(read(EPOS4, absent), Err(Refusal::new(0x3299, 1, Reason::Missing)));
}

#[test]
fn a_current_without_a_rated_one_is_not_taken_for_per_mille() {
    let eds = Eds::parse(EPOS.as_bytes()).unwrap();
    let derived = derive(&eds, NODE, &Description { second_way: true, ..wheel() }).unwrap();
    assert!(derived.table.motor.is_empty(), "0x6078 of the EPOS is in mA, and it has no 0x6075");
}

#[test]
fn the_greatest_speed_of_the_motor_is_compared_or_written() {
    // 1 m/s, 20 turns of the motor in 0.5 m: 2400 rpm.
    let with_motor = |access: &str| {
        GENERIC.to_string()
            + &format!("\n[6080]\nParameterName=x\nObjectType=7\nDataType=7\nAccessType={access}\nHighLimit=5000\n")
    };
    let given = |motor_rpm_max| {
        let quirks = Quirks { motor_rpm_max, ..Quirks::default() };
        move |gear: f64| Description { quirks: quirks.clone(), gear: Some(gear), ..wheel() }
    };
    let compared = |derived: &Derived| derived.table.identity.iter().find(|own| own.index == 0x6080).copied();
    let as_it_is = derived(&with_motor("rw"), &given(None)(20.0)).unwrap();
    assert_eq!(compared(&as_it_is), Some(Expect::at_least(0x6080, 0, 2400)));
    assert_eq!(written(&as_it_is, 0x6080, 0), None);
    // The direction of the gear does not matter, and a part of a turn per minute is needed whole.
    assert_eq!(compared(&derived(&with_motor("rw"), &given(None)(-20.001)).unwrap()).unwrap().min, 2401);
    let set = derived(&with_motor("rw"), &given(Some(3000))(20.0)).unwrap();
    assert_eq!((compared(&set), written(&set, 0x6080, 0)), (None, Some(3000)));
    // As far as the drive takes it; what it does not take is refused.
    assert_eq!(written(&derived(&with_motor("rw"), &given(Some(9000))(20.0)).unwrap(), 0x6080, 0), Some(5000));
    let reason = Reason::OutOfLimits { value: 6000, low: 0, high: 5000 };
    let refusal = derived(&with_motor("rw"), &given(Some(9000))(50.0)).unwrap_err();
    assert_eq!(refusal, Refusal { index: 0x6080, sub: 0, reason });
    // One that cannot be written is compared in any case; one that cannot be read either is not.
    let fixed = derived(&with_motor("ro"), &given(Some(3000))(20.0)).unwrap();
    assert_eq!((compared(&fixed).map(|own| own.min), written(&fixed, 0x6080, 0)), (Some(2400), None));
    assert_eq!(compared(&derived(&with_motor("wo"), &given(None)(20.0)).unwrap()), None);
    assert_eq!(compared(&derived(GENERIC, &given(None)(20.0)).unwrap()), None);
}

#[test]
fn a_velocity_may_be_commanded_in_a_period_with_sync_or_without() {
    // It has modes 1, 3, 6 and 8; then 9 in place of 3.
    let only_cyclic = with(GENERIC, "6502", "DefaultValue", "0x1A1");
    let mode = |text: &str| velocity_mode(&read(text), NODE);
    assert_eq!([mode(GENERIC), mode(&only_cyclic)], [Mode::ProfileVelocity, Mode::CyclicVelocity]);
    let both = with(GENERIC, "6502", "DefaultValue", "0x1A5");
    assert_eq!(mode(&both), Mode::ProfileVelocity);
    // One that has neither is refused in the usual mode.
    assert_eq!(mode(&with(GENERIC, "6502", "DefaultValue", "0x21")), Mode::ProfileVelocity);

    let ms = Duration::from_millis;
    let cyclic = |sync, setpoints| Description { mode: Mode::CyclicVelocity, sync, setpoints, ..wheel() };
    let kinds = |derived: &Derived| {
        let node = derived.table.node_config("drive", &derived.parameters);
        node.mappings.iter().map(|pdo| pdo.kind).collect::<Vec<_>>()
    };
    let own = derived(&only_cyclic, &cyclic(None, Some(ms(20)))).unwrap();
    assert_eq!((kinds(&own), written(&own, 0x6060, 0)), ([255, 255].into(), Some(9)));
    assert!(own.table.identity.contains(&Mode::expect(&[Mode::CyclicVelocity])));
    let at_sync = derived(&only_cyclic, &cyclic(Some(ms(10)), Some(ms(20)))).unwrap();
    assert_eq!(kinds(&at_sync), [1, 1]);
    // One that takes no other than a PDO at an event gets that.
    let events = with(&only_cyclic, "1403sub2", "LowLimit", "254");
    assert_eq!(kinds(&derived(&events, &cyclic(Some(ms(10)), None)).unwrap()), [255, 1]);

    // A stop must not wait for a slow SYNC.
    let reason = Reason::OutOfLimits { value: 20_001, low: 1000, high: 20_000 };
    let refusal = derived(&only_cyclic, &cyclic(Some(Duration::from_micros(20_001)), None)).unwrap_err();
    assert_eq!(refusal, Refusal { index: 0x1006, sub: 0, reason });
    let refusal = derived(&only_cyclic, &cyclic(None, None)).unwrap_err();
    assert_eq!(refusal, Refusal { index: 0x1006, sub: 0, reason: Reason::NoSync });

    // The period is written in ms, where it is that.
    let periods = "\n[60C2]\nParameterName=x\nObjectType=9\nSubNumber=3\n".to_string()
        + "[60C2sub1]\nParameterName=x\nObjectType=7\nDataType=5\nAccessType=rw\n"
        + "[60C2sub2]\nParameterName=x\nObjectType=7\nDataType=2\nAccessType=rw\n";
    let with_periods = without(&only_cyclic, "60C2") + &periods;
    for (sync, expected) in [(Some(ms(10)), (10, 0xFD)), (None, (20, 0xFD)), (Some(ms(5) / 2), (25, 0xFC))] {
        let derived = derived(&with_periods, &cyclic(sync, Some(ms(20)))).unwrap();
        let parts = [1, 2].map(|sub| written(&derived, 0x60C2, sub));
        assert_eq!(parts, [Some(expected.0), Some(expected.1)], "{sync:?}");
    }
}

#[test]
fn a_position_may_be_interpolated() {
    let objects = "\n[60C1]\nParameterName=x\nObjectType=9\nSubNumber=2\n".to_string()
        + "[60C1sub1]\nParameterName=x\nObjectType=7\nDataType=4\nAccessType=rw\nPDOMapping=1\n"
        + "[60C0]\nParameterName=x\nObjectType=7\nDataType=3\nAccessType=rw\n";
    let text = with(&(GENERIC.to_string() + &objects), "6502", "DefaultValue", "0x64");
    assert_eq!(position_mode(&read(&text), NODE), Mode::Interpolated);
    let cyclic = with(&text, "6502", "DefaultValue", "0xE4");
    assert_eq!(position_mode(&read(&cyclic), NODE), Mode::CyclicPosition);
    assert_eq!(position_mode(&read(GENERIC), NODE), Mode::ProfilePosition);

    let wanted = |sync| Description { mode: Mode::Interpolated, sync, ..steering() };
    let own = derived(&text, &wanted(Some(Duration::from_millis(10)))).unwrap();
    assert_eq!((own.table.rpdo.entries.to_vec(), own.table.rpdo.adjust), (vec![0x6040_0010, 0x60C1_0120], true));
    assert_eq!((written(&own, 0x60C0, 0), written(&own, 0x6060, 0)), (Some(0), Some(7)));
    assert_eq!(own.table.pack(0x1F, -2)[..], [0x1F, 0, 0xFE, 0xFF, 0xFF, 0xFF]);
    let refusal = derived(&text, &wanted(None)).unwrap_err();
    assert_eq!(refusal, Refusal { index: 0x1006, sub: 0, reason: Reason::NoSync });
    let refusal = derived(&with(&text, "60C1sub1", "DataType", "3"), &wanted(None)).unwrap_err();
    assert_eq!(refusal, Refusal { index: 0x60C1, sub: 1, reason: Reason::Type });

    // A period that cannot be written must be that of the set-points, and one that the drive does not take refuses it.
    let of = |text: &str| derived(text, &wanted(Some(Duration::from_millis(10))));
    assert_eq!([1, 2].map(|sub| written(&own, 0x60C2, sub)), [Some(10), Some(0xFD)]);
    let fixed = of(&with(&text, "60C2sub1", "AccessType", "ro")).unwrap().table;
    assert!(fixed.identity.contains(&Expect::masked(0x60C2, 1, 0xFF, 10)));
    assert!(fixed.settings.iter().all(|setting| (setting.index, setting.sub) != (0x60C2, 1)));
    let refusal = of(&with(&text, "60C2sub1", "HighLimit", "4")).unwrap_err();
    let reason = Reason::OutOfLimits { value: 10, low: 0, high: 4 };
    assert_eq!(refusal, Refusal { index: 0x60C2, sub: 1, reason });
}
