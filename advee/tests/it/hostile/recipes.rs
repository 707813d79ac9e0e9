//! Input that has done harm, and its mutations.

use base::can::Frame;
use messages::{Message, common, lowlevel, middlelevel};
use module::State;
use simulator::Random;

/// A number below `end`.
pub fn below(random: &mut Random, end: usize) -> usize {
    (random.bits() % end.max(1) as u64) as usize
}

/// One of a list.
pub fn pick<'a, T>(random: &mut Random, list: &'a [T]) -> &'a T {
    &list[below(random, list.len())]
}

/// Numbers at which lengths, counts and values break.
const EDGES: [u64; 12] = [
    0,
    1,
    0x7F,
    0xFFFF,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    1 << 28,
    u64::MAX,
    // NaN, infinity, 1e308.
    0x7FF8_0000_0000_0000,
    0x7FF0_0000_0000_0000,
    0x7FE1_CCF3_85EB_C8A0,
];

/// Changes some bytes from `keep` on: none in every eighth, so that the recipe itself comes, too.
pub fn mutate(random: &mut Random, bytes: &mut Vec<u8>, keep: usize) {
    for _ in 0..below(random, 8) {
        let keep = keep.min(bytes.len());
        let at = keep + below(random, bytes.len() - keep);
        match below(random, 6) {
            0 if at < bytes.len() => bytes[at] ^= 1 << below(random, 8),
            1 if at < bytes.len() => bytes[at] = random.bits() as u8,
            2 => bytes.truncate(at),
            3 => {
                let piece: Vec<u8> = (0..below(random, 40)).map(|_| random.bits() as u8).collect();
                drop(bytes.splice(at..at, piece));
            }
            4 if at < bytes.len() => {
                bytes.remove(at);
            }
            _ => {
                let edge = pick(random, &EDGES).to_be_bytes();
                let width = *pick(random, &[2, 4, 8]);
                for (byte, edge) in bytes[at..].iter_mut().zip(&edge[8 - width..]) {
                    *byte = *edge;
                }
            }
        }
    }
}

/// Commands, releases and stops that nobody asked for.
pub fn forged(random: &mut Random) -> Message {
    let speed = *pick(random, &[0.3, -0.3, 1.2, 9.0, f64::NAN, f64::INFINITY, 1e308]);
    let process = |module: &str| common::Process {
        module: module.into(),
        phase: common::Process::RUNNING,
        state: State::Run as i8,
        pid: 1,
        ..Default::default()
    };
    let state = *pick(random, &[State::Run, State::Pause, State::Stop]) as i8;
    match below(random, 11) {
        0 => lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.1, priority: 3, source: "lan".into() }.into(),
        1 => {
            // The quick stop's ramp.
            let data = vec![60, 0, 0, 0];
            lowlevel::CmdSdo { timestamp: 0, request: 77, node: 1, index: 0x6085, subindex: 0, write: true, data }
                .into()
        }
        2 => common::CmdState { timestamp: 0, module: "*".into(), state, manual: true, source: "lan".into() }.into(),
        3 => lowlevel::EventStop { timestamp: 0, engaged: random.chance(0.2), source: "lan".into() }.into(),
        4 => {
            let names = ["driver_canbus", "driver_rs485a", "driver_power", "estimator", "planner"];
            common::DataProcesses { timestamp: 0, processes: names.map(process).into() }.into()
        }
        5 => lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() }.into(),
        6 => lowlevel::CmdPower { timestamp: 0, device: 3, action: lowlevel::CmdPower::OFF }.into(),
        7 => {
            let waypoints = vec![middlelevel::Waypoint { x: speed, ..Default::default() }];
            middlelevel::CmdGoal { waypoints, ..Default::default() }.into()
        }
        8 => {
            let (vy, omega, source) = (0.0, speed, "lan".into());
            lowlevel::CmdVelocity { timestamp: 0, vx: speed, vy, omega, priority: 3, source, session: 1 }.into()
        }
        9 => {
            let covariance = [[speed; 3]; 3];
            middlelevel::CmdEstimate { timestamp: 0, x: speed, y: 1.0, theta: 1e308, covariance }.into()
        }
        _ => middlelevel::DataEstimate { x: speed, ..Default::default() }.into(),
    }
}

/// A fragment that announces a message of any size.
pub fn fragment(random: &mut Random, channel: &str, payload: &[u8]) -> Vec<u8> {
    let size: u32 = *pick(random, &[1 << 28, (1 << 28) - 1, 0xFFFF_FFFF, 70_000, 8, 0]);
    let offset = *pick(random, &[0, 10, size.wrapping_sub(10), size, 0xFFFF_FFF0]);
    let count = *pick(random, &[2_u16, 1, 0, 0xFFFF, 4000]);
    let number = *pick(random, &[0, 1, count.wrapping_sub(1), count, 0xFFFF]);
    let mut datagram = b"LC03".to_vec();
    // Some belong together.
    datagram.extend(((random.bits() % 16) as u32).to_be_bytes());
    datagram.extend(size.to_be_bytes());
    datagram.extend(offset.to_be_bytes());
    datagram.extend(number.to_be_bytes());
    datagram.extend(count.to_be_bytes());
    if number == 0 {
        datagram.extend(channel.as_bytes());
        datagram.push(0);
    }
    datagram.extend(&payload[..payload.len().min(1000)]);
    datagram
}

/// Frames by which another master moves drives, resets them, or disables their stop; and frames as drives send them.
pub fn frame(random: &mut Random) -> Frame {
    let recipes: [(u16, &[u8]); 14] = [
        (0x501, &[0x0F, 0, 0xE9, 2, 0, 0]),
        (0x501, &[0x0F, 0, 0xFF, 0xFF, 0xFF, 0x7F]),
        (0x302, &[0x1F, 0, 0, 0, 2, 0]),
        (0x000, &[0x81, 0]),
        (0x000, &[2, 1]),
        (0x080, &[]),
        // The ramp of the quick stop; the monitoring of the master's heartbeat.
        (0x601, &[0x23, 0x85, 0x60, 0, 60, 0, 0, 0]),
        (0x601, &[0x23, 0x16, 0x10, 1, 0, 0, 0, 0]),
        (0x602, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]),
        (0x181, &[0x37, 2]),
        (0x481, &[0x37, 2, 0, 0, 0, 0]),
        (0x081, &[0x10, 0x23, 4, 0, 0, 0, 0, 0]),
        (0x701, &[5]),
        (0x77F, &[5]),
    ];
    let (id, data) = *pick(random, &recipes);
    let mut data = data.to_vec();
    mutate(random, &mut data, 0);
    data.truncate(8);
    // Configuration of node ids (0x7E4, 0x7E5) outlasts the round.
    let id = if random.chance(0.2) { below(random, 0x780) as u16 } else { id };
    Frame::standard(id, &data)
}

/// Requests to the web server; those that hold a connection open first.
pub const REQUESTS: [&[u8]; 16] = [
    b"GET / HTTP/1.1\r\nHost: localhost\r\nX-A: ",
    b"POST /api/pair HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n{",
    b"GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /health HTTP/1.1\r\nHost: attacker.example\r\n\r\n",
    b"GET /api/logs/../../../../etc/passwd HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /api/logs/%2e%2e/%2e%2e/etc%00/x HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: 10.0.0.1\r\n\r\n",
    b"POST /api/stop HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n",
    b"POST /api/pair HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\nContent-Length: 19\r\n\r\n\
      {\"code\":\"00000000\"}",
    b"POST /api/pair HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFF\r\nx\r\n",
    b"GET /ws/view HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
      Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n\x82\xff\x7f\xff\xff\xff\xff\xff\
      \xff\xff\x00\x00\x00\x00",
    b"GET /ws/command HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
      Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n\x81\x85\x00\x00\x00\x00hello",
    b"GET /foxglove HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
      Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: \
      foxglove.sdk.v1\r\n\r\n\x81\x80\x00\x00\x00\x00",
    b"GET / HTTP/0.9\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    b"DELETE /api/devices HTTP/1.1\r\nHost: localhost\r\nCookie: a=\xff\xfe\r\nContent-Length: -1\r\n\r\n",
];
