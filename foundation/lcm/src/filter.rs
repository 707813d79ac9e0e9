//! Socket filter: a classic BPF program decides which datagrams the kernel passes to a process: by their origin, and by
//! channel names.
//!
//! A bus with TTL 0 belongs to this computer alone. The TTL limits what leaves; [`local`] limits what enters: it passes
//! only datagrams that the kernel looped back to this host (`PACKET_LOOPBACK`) or that came over `lo`. It is attached
//! before the socket is bound and stays, whatever the subscriptions are.
//!
//! Without a filter of names each process on the bus is woken for each message, wanted or not. With it, unwanted
//! messages cost their reader nothing. The program sees the datagram from its UDP header on; a load beyond the end
//! drops the datagram, so the names are compared in order of their length. It passes
//! - short messages and first fragments on the wanted channels, and LCM's self test;
//! - later fragments, which carry no channel name, except our own if this process does not want them;
//! - datagrams that are not LCM's, to be counted.
//!
//! Source: Linux `Documentation/networking/filter.rst`.

use crate::udpm::{CHANNEL_MAX, FRAGMENT_MAGIC, SHORT_MAGIC};
use core::net::SocketAddrV4;

/// Channel on which a subscriber of `liblcm` receives a message of its own, once, to test the bus.
pub const SELF_TEST: &str = "LCM_SELF_TEST";

/// An instruction, as in `linux/filter.h`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Operation.
    pub code: u16,
    /// Instructions to skip if true.
    pub jt: u8,
    /// Instructions to skip if false.
    pub jf: u8,
    /// Operand.
    pub k: u32,
}

/// The longest program that the kernel takes (`BPF_MAXINSNS`).
pub const LENGTH_MAX: usize = 4096;

/// Ancillary data (`SKF_AD_OFF`): kind of packet, and index of the interface.
const PACKET_TYPE: u32 = 0xffff_f000 + 4;
const INTERFACE: u32 = 0xffff_f000 + 8;
/// A multicast of this host, looped back (`linux/if_packet.h`).
const PACKET_LOOPBACK: u32 = 5;
/// `lo` has this index in every network name space (Linux `LOOPBACK_IFINDEX`).
const LO: u32 = 1;

const LD_LEN: u16 = 0x80; // A = length of the datagram
const LD_W: u16 = 0x20; // A = 32 bits at k
const LD_H: u16 = 0x28; // 16 bits
const LDX: u16 = 0x01; // X = k
const LD_W_X: u16 = 0x40; // A = 32 bits at X + k
const LD_H_X: u16 = 0x48;
const LD_B_X: u16 = 0x50;
const JEQ: u16 = 0x15;
const JGE: u16 = 0x35;
const RET: u16 = 0x06;

const ALL: u32 = u32::MAX;
/// Offset of the IP header (`SKF_NET_OFF`), and of the source address in it.
const IP_SOURCE: u32 = 0xfff0_0000 + 12;
const SOURCE_PORT: u32 = 0;
/// Behind the 8 bytes of UDP.
const MAGIC: u32 = 8;
const FRAGMENT_NUMBER: u32 = 8 + 16;
const CHANNEL: u32 = 8 + 8;
/// Additional offset of the channel in a first fragment.
const FRAGMENT_MORE: u32 = 12;
/// UDP's header, LCM's, and the NUL of an empty name.
const SHORT_MIN: u32 = 8 + 8 + 1;
const FRAGMENT_MIN: u32 = 8 + 20;

const fn op(code: u16, k: u32) -> Instruction {
    Instruction { code, jt: 0, jf: 0, k }
}

const fn jump(code: u16, k: u32, jt: u8, jf: u8) -> Instruction {
    Instruction { code, jt, jf, k }
}

/// The program that passes all datagrams of this host, and none from other hosts.
#[must_use]
pub fn local() -> Vec<Instruction> {
    let mut program = only_local().to_vec();
    program.push(op(RET, ALL));
    program
}

/// Drops datagrams of other hosts; else continues.
const fn only_local() -> [Instruction; 5] {
    [op(LD_W, PACKET_TYPE), jump(JEQ, PACKET_LOOPBACK, 3, 0), op(LD_W, INTERFACE), jump(JEQ, LO, 1, 0), op(RET, 0)]
}

/// The program that passes messages on the channels `names`; of this host only, if `is_local`. `own` is where our own
/// messages come from; their later fragments pass if `own_fragments`. `None`: it would be too long for the kernel.
#[must_use]
pub fn program(names: &[&str], own: SocketAddrV4, own_fragments: bool, is_local: bool) -> Option<Vec<Instruction>> {
    // A longer name is on no datagram, and its jumps would be too far.
    let possible = names.iter().copied().filter(|name| name.len() <= CHANNEL_MAX);
    let mut names: Vec<&str> = possible.chain([SELF_TEST]).collect();
    names.sort_unstable_by_key(|name| (name.len(), *name));
    names.dedup();
    let mut program = if is_local { only_local().to_vec() } else { Vec::new() };
    program.extend([
        op(LD_LEN, 0),
        jump(JGE, SHORT_MIN, 1, 0),
        op(RET, ALL),
        op(LD_W, MAGIC),
        op(LDX, 0),
        jump(JEQ, SHORT_MAGIC, 15, 0), // to the names
        jump(JEQ, FRAGMENT_MAGIC, 1, 0),
        op(RET, ALL),
        op(LD_LEN, 0),
        jump(JGE, FRAGMENT_MIN, 1, 0),
        op(RET, ALL),
        op(LD_H, FRAGMENT_NUMBER),
        jump(JEQ, 0, 7, 0), // to the names, which stand later here
        op(LD_H, SOURCE_PORT),
        jump(JEQ, own.port().into(), 1, 0),
        op(RET, ALL),
        op(LD_W, IP_SOURCE),
        jump(JEQ, (*own.ip()).into(), 1, 0),
        op(RET, ALL),
        op(RET, if own_fragments { ALL } else { 0 }),
        op(LDX, FRAGMENT_MORE),
    ]);
    for name in names {
        compare(&mut program, name);
    }
    program.push(op(RET, 0));
    (program.len() <= LENGTH_MAX).then_some(program)
}

/// Passes the datagram if name and NUL are at [`CHANNEL`] + X; else continues.
fn compare(program: &mut Vec<Instruction>, name: &str) {
    let bytes: Vec<u8> = name.bytes().chain([0]).collect();
    let mut loads: Vec<(u16, usize, u32)> = Vec::new();
    let number = |bytes: &[u8]| bytes.iter().fold(0, |number, &byte| number << 8 | u32::from(byte));
    for (index, word) in bytes.chunks(4).enumerate() {
        match (word.len(), bytes.len()) {
            (4, _) => loads.push((LD_W_X, 4 * index, number(word))),
            // The last four bytes, some of them once more.
            (_, len @ 4..) => loads.push((LD_W_X, len - 4, number(&bytes[len - 4..]))),
            (3, _) => loads.extend([(LD_H_X, 0, number(&word[..2])), (LD_B_X, 2, number(&word[2..]))]),
            (2, _) => loads.push((LD_H_X, 0, number(word))),
            _ => loads.push((LD_B_X, 0, number(word))),
        }
    }
    let count = loads.len();
    for (index, (code, at, value)) in loads.into_iter().enumerate() {
        program.push(op(code, CHANNEL + at as u32));
        // To behind this name's RET: two instructions for each load that is left, and that one.
        program.push(jump(JEQ, value, 0, (2 * (count - index - 1) + 1) as u8));
    }
    program.push(op(RET, ALL));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::udpm::{DATAGRAM_MAX, Message};
    use core::net::Ipv4Addr;

    const OWN: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 40_000);
    const OTHER: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 40_001);

    /// Kinds of packet and interfaces: looped back on one, over `lo`, from another host (`PACKET_MULTICAST`).
    const LOOPED: (u32, u32) = (5, 7);
    const OVER_LO: (u32, u32) = (2, 1);
    const FOREIGN: (u32, u32) = (2, 7);

    /// Simulates the kernel: true if the program passes this payload of a UDP datagram.
    fn passes(program: &[Instruction], from: SocketAddrV4, payload: &[u8]) -> bool {
        passes_by(program, FOREIGN, from, payload)
    }

    fn passes_by(program: &[Instruction], (kind, interface): (u32, u32), from: SocketAddrV4, payload: &[u8]) -> bool {
        let mut udp = Vec::from(from.port().to_be_bytes());
        udp.extend([0; 6]);
        udp.extend(payload);
        let load = |at: usize, size: usize| {
            if at == IP_SOURCE as usize {
                return Some(u32::from(*from.ip()));
            }
            match at as u32 {
                PACKET_TYPE => return Some(kind),
                INTERFACE => return Some(interface),
                _ => {}
            }
            let bytes = udp.get(at..at + size)?;
            Some(bytes.iter().fold(0, |number, &byte| number << 8 | u32::from(byte)))
        };
        let (mut a, mut x, mut at) = (0, 0, 0);
        loop {
            let Instruction { code, jt, jf, k } = program[at];
            at += 1;
            let size = match code {
                LD_W | LD_W_X => 4,
                LD_H | LD_H_X => 2,
                _ => 1,
            };
            match code {
                LD_LEN => a = udp.len() as u32,
                LDX => x = k,
                LD_W | LD_H | LD_W_X | LD_H_X | LD_B_X => {
                    let index = if matches!(code, LD_W | LD_H) { 0 } else { x as usize };
                    let Some(value) = load(index + k as usize, size) else { return false };
                    a = value;
                }
                JEQ => at += usize::from(if a == k { jt } else { jf }),
                JGE => at += usize::from(if a >= k { jt } else { jf }),
                RET => return k != 0,
                _ => panic!("instruction {code:#x}"),
            }
        }
    }

    fn datagrams(channel: &str, len: usize) -> Vec<Vec<u8>> {
        let payload = vec![b'x'; len];
        let message = Message::new(0, channel, &payload, DATAGRAM_MAX).unwrap();
        let datagram = |number| {
            let (header, rest) = message.datagram(number);
            [&header[..], rest].concat()
        };
        (0..message.count()).map(datagram).collect()
    }

    const NAMES: [&str; 9] =
        ["A", "AB", "ABC", "ABCD", "ABCDE", "ABCDEF", "LL_DATA_ODO", "LL_DATA_SRFS", "CM_CMD_STATE"];

    #[test]
    fn wanted_names_pass_and_others_do_not() {
        let longest = "N".repeat(63);
        let names: Vec<&str> = NAMES.into_iter().chain([longest.as_str()]).collect();
        let program = program(&names, OWN, false, false).unwrap();
        for len in [0, 1, 3, 70_000] {
            for name in &names {
                assert!(passes(&program, OTHER, &datagrams(name, len)[0]), "{name} {len}");
                let longer = format!("{}X", &name[..name.len().min(62)]);
                assert!(!passes(&program, OTHER, &datagrams(&longer, len)[0]), "{longer} {len}");
                let shorter = &name[..name.len() - 1];
                if !shorter.is_empty() && !names.contains(&shorter) {
                    assert!(!passes(&program, OTHER, &datagrams(shorter, len)[0]), "{shorter} {len}");
                }
                let other = format!("x{}", &name[1..]);
                assert!(!passes(&program, OTHER, &datagrams(&other, len)[0]), "{other} {len}");
            }
            assert!(passes(&program, OTHER, &datagrams(SELF_TEST, len)[0]));
        }
    }

    #[test]
    fn later_fragments_pass_unless_they_are_our_own() {
        let later = &datagrams("UNWANTED", 70_000)[1];
        let elsewhere = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 1), OWN.port());
        for own_fragments in [false, true] {
            let program = program(&NAMES, OWN, own_fragments, false).unwrap();
            assert!(passes(&program, OTHER, later) && passes(&program, elsewhere, later));
            assert_eq!(passes(&program, OWN, later), own_fragments);
        }
    }

    #[test]
    fn what_is_not_lcms_passes_to_be_counted() {
        let program = program(&[], OWN, false, false).unwrap();
        for datagram in [&b""[..], b"hello", b"LC02\0\0\0\0", b"hello you there", b"LC03\0\0\0\0\0\0\0\0\0"] {
            assert!(passes(&program, OTHER, datagram), "{datagram:?}");
        }
        assert!(!passes(&program, OTHER, &datagrams("A", 0)[0]));
    }

    #[test]
    fn a_name_that_no_datagram_can_have_is_no_matter() {
        let long = "N".repeat(5000);
        assert_eq!(program(&[&long, "A"], OWN, false, false), program(&["A"], OWN, false, false));
    }

    #[test]
    fn a_bus_of_this_computer_passes_nothing_of_another_one() {
        let names = program(&NAMES, OWN, true, true).unwrap();
        for by in [LOOPED, OVER_LO, FOREIGN] {
            for (name, wanted) in [("A", true), ("LL_DATA_ODO", true), ("UNWANTED", false)] {
                for (number, datagram) in datagrams(name, 70_000).iter().enumerate() {
                    let ours = by != FOREIGN;
                    assert_eq!(passes_by(&local(), by, OTHER, datagram), ours);
                    assert_eq!(passes_by(&names, by, OTHER, datagram), ours && (wanted || number > 0), "{name} {by:?}");
                }
            }
            for noise in [&b""[..], b"hello", b"hello you there and more of it"] {
                assert_eq!(passes_by(&names, by, OTHER, noise), by != FOREIGN);
                assert_eq!(passes_by(&local(), by, OTHER, noise), by != FOREIGN);
            }
        }
    }

    #[test]
    fn a_program_too_long_for_the_kernel_is_none() {
        let names: Vec<String> = (0..200).map(|n| format!("{n:063}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        assert!(program(&names[..100], OWN, false, false).is_some());
        assert_eq!(program(&names, OWN, false, false), None);
    }
}
