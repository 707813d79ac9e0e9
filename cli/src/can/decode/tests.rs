//! Transcripts typed from CiA 301, CiA 305 and `docs/facts`: what stands on the wire, and what is said of it.

use super::*;
use crate::can::target::{Known, Target};
use drivers::canbus::{Drive, WheelKeys, table};
use host::ports::PortConfig;

fn decoder() -> Decoder {
    let known = |id, name: &str, drive| Known { id, name: name.into(), drive, eds: None };
    let drive = Drive::Wheel(WheelKeys { gear: 1.0, table: table::built_in("epos") });
    let target = Target {
        name: "can.main".into(),
        raw: None,
        port: PortConfig::CanSocket { interface: "can0".into() },
        bitrate: 500_000,
        known: vec![known(1, "propulsion", drive)],
        master: None,
        numbers_from: Some(0),
    };
    Decoder::new(Book::new(&target, None).unwrap())
}

/// `601 40 41 60 …`, `705 r1` for a remote frame of one byte, `x00001234 01` for an extended one.
fn frame(text: &str) -> Frame {
    let mut words = text.split_whitespace();
    let id = words.next().unwrap();
    let id = match id.strip_prefix('x') {
        Some(id) => Id::Extended(u32::from_str_radix(id, 16).unwrap()),
        None => Id::Standard(u16::from_str_radix(id, 16).unwrap()),
    };
    let words: Vec<&str> = words.collect();
    if let [word] = words[..]
        && let Some(len) = word.strip_prefix('r')
    {
        return Frame::remote(id, len.parse().unwrap()).unwrap();
    }
    let data: Vec<u8> = words.iter().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
    Frame::new(id, &data).unwrap()
}

/// Lines `frame | service node says`; `-` for no node.
#[track_caller]
fn check(decoder: &mut Decoder, transcript: &str) {
    for line in transcript.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let (wire, expected) = line.split_once('|').unwrap();
        let (_, told) = decoder.frame(&frame(wire));
        let node = told.node.map_or("-".into(), |node| node.to_string());
        let said = format!("{} {node} {}", told.what, told.says);
        assert_eq!(said.trim_end(), expected.trim(), "{wire}");
    }
}

#[test]
fn a_network_is_managed_and_tells_of_itself() {
    check(
        &mut decoder(),
        "000 82 05               | NMT → 5 reset communication
         705 00                  | boot-up 5 has booted
         705 7f                  | heartbeat 5 pre-operational, was initialising
         000 01 00               | NMT → - start all nodes
         705 05                  | heartbeat 5 operational, was pre-operational
         705 05                  | heartbeat 5 operational
         705 r1                  | guard → 5 asks for the state
         705 85                  | guard ← 5 operational (toggled)
         080                     | SYNC -
         080 07                  | SYNC - 7
         100 00 2e 93 02 1d 27   | TIME - 2011-06-01 12:00:00.000
         081 30 81 11 00 00 00 00 00 | EMCY 1 0x8130 life guard or heartbeat error, register 0x11 (generic, communication)
         081 00 00 00 00 00 00 00 00 | EMCY 1 0x0000 no error any more, register 0x00
         000 82                  | NMT - malformed: 82
         705 06                  | heartbeat 5 malformed: 06
         101 01                  | ? - 01
         x00000181 01            | ? - 01",
    );
}

#[test]
fn objects_are_read_and_written_by_name() {
    check(
        &mut decoder(),
        "601 40 41 60 00 00 00 00 00 | SDO → 1 read 0x6041 Statusword
         581 4b 41 60 00 37 02 00 00 | SDO ← 1 0x6041 Statusword = 0x0237 operation enabled
         601 2b 17 10 00 64 00 00 00 | SDO → 1 write 0x1017 Producer heartbeat time = 100
         581 60 17 10 00 00 00 00 00 | SDO ← 1 0x1017 Producer heartbeat time written
         601 2f 00 50 00 01 00 00 00 | SDO → 1 write 0x5000 = 0x01 (1)
         581 80 00 50 00 00 00 02 06 | SDO ← 1 0x5000: aborted: object does not exist (0x06020000)
         607 40 40 60 00 00 00 00 00 | SDO → 7 read 0x6040 Controlword
         587 4b 41 60 00 37 02 00 00 | SDO ← 7 0x6041 Statusword = 0x0237 operation enabled
         587 30 00 00 00 00 00 00 00 | SDO ← 7 fits nothing heard before: 30 00 00 00 00 00 00 00
         587 30                      | SDO ← 7 fits nothing heard before: 30",
    );
}

#[test]
fn a_segmented_transfer_is_followed_to_its_end() {
    check(
        &mut decoder(),
        "605 40 08 10 00 00 00 00 00 | SDO → 5 read 0x1008 Manufacturer device name
         585 41 08 10 00 0a 00 00 00 | SDO ← 5 0x1008 Manufacturer device name: 10 bytes follow
         605 60 00 00 00 00 00 00 00 | SDO → 5 0x1008: after 0 of 10 bytes
         585 00 61 20 64 65 76 69 63 | SDO ← 5 0x1008: 7 of 10 bytes
         605 70 00 00 00 00 00 00 00 | SDO → 5 0x1008: after 7 of 10 bytes
         585 19 65 20 38 00 00 00 00 | SDO ← 5 0x1008 Manufacturer device name = \"a device 8\"
         605 21 08 10 00 08 00 00 00 | SDO → 5 write 0x1008 Manufacturer device name, 8 bytes
         585 60 08 10 00 00 00 00 00 | SDO ← 5 0x1008 Manufacturer device name: may be written
         605 00 61 62 63 64 65 66 67 | SDO → 5 0x1008: 7 of 8 bytes
         585 20 00 00 00 00 00 00 00 | SDO ← 5 0x1008: after 7 of 8 bytes
         605 1d 68 00 00 00 00 00 00 | SDO → 5 0x1008: 8 of 8 bytes
         585 30 00 00 00 00 00 00 00 | SDO ← 5 0x1008 Manufacturer device name written",
    );
}

#[test]
fn a_block_transfer_is_followed_though_its_segments_have_no_command() {
    // The first segment looks like the answer to a download, the second begins like an abort would with number 0.
    check(
        &mut decoder(),
        "605 c6 50 1f 01 0a 00 00 00 | SDO → 5 write 0x1F50:1 Program data, 10 bytes, in blocks
         585 a4 50 1f 01 02 00 00 00 | SDO ← 5 0x1F50:1 Program data: may be written
         605 01 60 00 00 00 00 00 00 | SDO → 5 0x1F50:1: 7 of 10 bytes
         605 82 80 00 00 00 00 00 00 | SDO → 5 0x1F50:1: 14 of 10 bytes
         585 a2 01 02 00 00 00 00 00 | SDO ← 5 0x1F50:1: after 7 of 10 bytes
         605 81 80 00 00 00 00 00 00 | SDO → 5 0x1F50:1: 14 of 10 bytes
         585 a2 01 02 00 00 00 00 00 | SDO ← 5 0x1F50:1: after 14 of 10 bytes
         605 d1 12 34 00 00 00 00 00 | SDO → 5 0x1F50:1: 10 of 10 bytes
         585 a1 00 00 00 00 00 00 00 | SDO ← 5 0x1F50:1 Program data written, 10 bytes
         605 a4 08 10 00 7f 00 00 00 | SDO → 5 read 0x1008 Manufacturer device name, in blocks
         585 c6 08 10 00 09 00 00 00 | SDO ← 5 0x1008 Manufacturer device name: 9 bytes follow
         605 a3 00 00 00 00 00 00 00 | SDO → 5 0x1008: after 0 of 9 bytes
         585 01 61 20 64 65 76 69 63 | SDO ← 5 0x1008: 7 of 9 bytes
         585 82 65 38 00 00 00 00 00 | SDO ← 5 0x1008: 14 of 9 bytes
         605 a2 02 7f 00 00 00 00 00 | SDO → 5 0x1008: after 14 of 9 bytes
         585 d5 12 34 00 00 00 00 00 | SDO ← 5 0x1008 Manufacturer device name = \"a device8\"
         605 a1 00 00 00 00 00 00 00 | SDO → 5 0x1008: after 9 of 9 bytes
         605 a4 41 60 00 7f 04 00 00 | SDO → 5 read 0x6041 Statusword, in blocks
         585 4b 41 60 00 37 02 00 00 | SDO ← 5 0x6041 Statusword = 0x0237 operation enabled
         605 c6 50 1f 01 0a 00 00 00 | SDO → 5 write 0x1F50:1 Program data, 10 bytes, in blocks
         585 a4 50 1f 01 02 00 00 00 | SDO ← 5 0x1F50:1 Program data: may be written
         605 80 50 1f 01 00 00 04 05 | SDO → 5 0x1F50:1 Program data: aborted: SDO protocol timed out (0x05040000)",
    );
}

#[test]
fn pdos_are_read_by_what_is_mapped_in_them() {
    check(
        &mut decoder(),
        "501 0f 00 24 fa ff ff       | RPDO4 1 Controlword 0x000F enable, Target velocity -1500
         181 37 02                   | TPDO1 1 Statusword 0x0237 operation enabled
         181 37                      | TPDO1 1 shorter than its mapping: 37
         181 r2                      | TPDO1 1 asked for
         205 01 02                   | RPDO1 5 01 02",
    );
}

#[test]
fn a_mapping_that_is_changed_is_learnt_and_forgotten_with_a_reset() {
    let remap = |node: u8, target: &str| {
        format!(
            "60{node} 23 00 18 01 8{node} 01 00 80 | SDO → {node} write 0x1800:1 TPDO1 COB-ID = 0x8000018{node}
             58{node} 60 00 18 01 00 00 00 00 | SDO ← {node} 0x1800:1 TPDO1 COB-ID written
             60{node} 2f 00 1a 00 00 00 00 00 | SDO → {node} write 0x1A00 TPDO1 mapped objects = 0
             58{node} 60 00 1a 00 00 00 00 00 | SDO ← {node} 0x1A00 TPDO1 mapped objects written
             60{node} 23 00 1a 01 08 00 61 60 | SDO → {node} write 0x1A00:1 TPDO1 mapped object 1 = 0x60610008
             58{node} 60 00 1a 01 00 00 00 00 | SDO ← {node} 0x1A00:1 TPDO1 mapped object 1 written
             60{node} 2f 00 1a 00 01 00 00 00 | SDO → {node} write 0x1A00 TPDO1 mapped objects = 1
             58{node} 60 00 1a 00 00 00 00 00 | SDO ← {node} 0x1A00 TPDO1 mapped objects written
             60{node} 23 00 18 01 {target} 00 00 | SDO → {node} write 0x1800:1 TPDO1 COB-ID = 0x00000{}
             58{node} 60 00 18 01 00 00 00 00 | SDO ← {node} 0x1800:1 TPDO1 COB-ID written",
            target.split(' ').rev().collect::<Vec<_>>().join("").trim_start_matches('0')
        )
    };
    let mut decoder = decoder();
    check(&mut decoder, &remap(5, "33 03"));
    check(
        &mut decoder,
        "333 03                      | TPDO1 5 Modes of operation display 3 profile velocity
         185 03                      | TPDO1 5 03
         705 00                      | boot-up 5 has booted
         333 03                      | RPDO2 51 03",
    );
}

#[test]
fn layer_setting_is_said_in_words() {
    check(
        &mut decoder(),
        "7e5 04 01 00 00 00 00 00 00 | LSS → - all to configuration
         7e5 11 05 00 00 00 00 00 00 | LSS → - set node id 5
         7e4 11 00 00 00 00 00 00 00 | LSS ← - node id: done
         7e5 13 00 03 00 00 00 00 00 | LSS → - set bit rate 250 kbit/s
         7e4 13 01 00 00 00 00 00 00 | LSS ← - bit rate: refused, error 1
         7e5 15 e8 03 00 00 00 00 00 | LSS → - activate bit rate after 1000 ms
         7e5 5a 00 00 00 00 00 00 00 | LSS → - inquire vendor
         7e4 5a fb 00 00 00 00 00 00 | LSS ← - vendor 0x000000FB
         7e5 51 00 00 00 00 80 00 00 | LSS → - fastscan: who has no node id?
         7e4 4f 00 00 00 00 00 00 00 | LSS ← - yes
         7e5 51 fb 00 00 00 00 00 01 | LSS → - fastscan: vendor 0x000000FB down to bit 0?, then product
         7e5 99 00 00 00 00 00 00 00 | LSS → - unknown: 99 00 00 00 00 00 00 00",
    );
}

#[test]
fn whatever_comes_is_said_and_no_memory_is_taken_for_it() {
    let mut decoder = decoder();
    // Every identifier with every first byte and length, thrice in other orders.
    for round in 0..3_u16 {
        for id in 0..=0x7FF_u16 {
            for first in 0..=0xFF_u8 {
                let first = first.wrapping_mul([1, 3, 7][usize::from(round)]);
                let data = [first, id as u8, (id >> 8) as u8, first & 0x7F, first, 0, 0x18, 1];
                let len = if first % 16 == 0 { usize::from(first) % 9 } else { 8 };
                let _ = decoder.frame(&Frame::standard(id, &data[..len]));
            }
        }
    }
    assert!(decoder.sdo.len() <= 127 && decoder.states.len() <= 127);
}
