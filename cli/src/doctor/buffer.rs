//! Where messages get lost: receive buffers, and the programs that own them.

use super::finding::{Finding, bytes};
use super::network::Listener;
use lcm::url::RECV_BUF_SIZE;
use std::collections::{BTreeMap, BTreeSet};

/// Ten times the traffic of MIT's car Talos (facts/lcm.md): messages a second, and their mean size in bytes.
pub const HEAVY_RATE: u64 = 67_750;
/// 166 MB/s.
pub const HEAVY_SIZE: usize = 2450;
/// Pause of a program that the buffer must bridge at that rate, ms: some turns of a busy processor's scheduler.
const HEAVY_PAUSE_MS: u64 = 50;
/// The largest piece of a message in a datagram, and the datagram (facts/lcm.md A1).
const PIECE: u64 = 65_487;
pub const DATAGRAM: usize = 65_507;
/// A message that must fit as a whole: its fragments come faster than a program is woken.
const LARGE_MESSAGE: u64 = 10_000_000;

/// The receive buffer: what was asked, what the kernel gives, and how far that goes here.
#[derive(Clone, Copy, Debug)]
pub struct Buffer {
    /// `recv_buf_size`, bytes.
    pub asked: usize,
    /// Size granted to this process; more than the limit where it is privileged.
    pub granted: usize,
    /// `net.core.rmem_max`, where it can be read.
    pub max: Option<u64>,
    /// Measured cost in the buffer of a datagram of [`HEAVY_SIZE`] and of one of [`DATAGRAM`].
    pub taken: (u64, u64),
}

impl Buffer {
    /// Value of `recv_buf_size` for heavy traffic and large messages, a whole number of MiB. The kernel doubles the
    /// requested size, and includes its own structures.
    fn recommended(&self) -> u64 {
        let pause = HEAVY_RATE * HEAVY_PAUSE_MS / 1000 * self.taken.0 / 2;
        let message = LARGE_MESSAGE.div_ceil(PIECE) * self.taken.1 / 2;
        pause.max(message).div_ceil(1 << 20) << 20
    }

    /// Pause that heavy traffic may have, ms, and largest message in one burst, MB, with `size`.
    fn carries(&self, size: u64) -> (f64, f64) {
        let whole = 2.0 * size as f64;
        let pause = whole / (HEAVY_RATE * self.taken.0.max(1)) as f64 * 1e3;
        (pause, (whole / self.taken.1.max(1) as f64).floor() * PIECE as f64 / 1e6)
    }
}

pub fn buffer(buffer: &Buffer) -> Finding {
    const CHECK: &str = "receive buffer";
    let recommended = buffer.recommended();
    let cure = |size: u64| {
        format!("echo net.core.rmem_max={size} | sudo tee /etc/sysctl.d/60-advee.conf && sudo sysctl --system")
    };
    let asked = buffer.asked as u64;
    // A privileged doctor gets more than the limit, the robot's modules need not.
    let usual = buffer.max.map_or(buffer.granted as u64, |max| max.min(asked));
    let (pause, message) = buffer.carries(usual);
    let carries = format!("{pause:.0} ms of heavy traffic, or a message of {message:.1} MB");
    if usual < asked {
        return Finding::warning(
            CHECK,
            format!("{} instead of {}: net.core.rmem_max is less than is asked for", bytes(usual), bytes(asked)),
        )
        .why(format!(
            "It holds {carries}; what comes while a program waits for its turn, and finds no room, is lost. \
             (Heavy: 10 times MIT's Talos, {HEAVY_RATE} messages/s.)"
        ))
        .cure(cure(recommended.max(asked)));
    }
    if asked >= recommended {
        return Finding::ok(CHECK, format!("{} as asked: {carries}", bytes(asked)));
    }
    // Enough for this robot; the text gives the size for more.
    let also = match buffer.max {
        Some(max) if max < recommended => format!(", net.core.rmem_max={recommended}"),
        _ => String::new(),
    };
    let default = if buffer.asked == RECV_BUF_SIZE { " as usual" } else { " as asked" };
    let more = format!("for more: recv_buf_size={recommended}{also}");
    Finding::ok(CHECK, format!("{}{default}: {carries}; {more}", bytes(asked)))
}

/// Listeners on the bus, and their losses. `overflows`: datagrams that any socket of this host lost to a full buffer.
pub fn listeners(listeners: &[Listener], overflows: u64) -> Finding {
    const CHECK: &str = "programs";
    if listeners.is_empty() {
        return Finding::ok(CHECK, "none is on the bus now");
    }
    let name = |listener: &Listener| match &listener.program {
        Some((name, _)) => name.clone(),
        None => format!("user {}'s", listener.uid),
    };
    let mut names: BTreeMap<String, usize> = BTreeMap::new();
    for listener in listeners {
        *names.entry(name(listener)).or_default() += 1;
    }
    let names: Vec<String> =
        names.into_iter().map(|(name, count)| if count == 1 { name } else { format!("{count} x {name}") }).collect();
    // Our sockets also count datagrams refused by their own filters.
    let lost = |listener: &&Listener| !listener.ours && listener.drops.min(overflows) > 0;
    if let Some(worst) = listeners.iter().filter(lost).max_by_key(|listener| listener.drops) {
        let pid = worst.program.as_ref().map_or(String::new(), |(_, pid)| format!(", process {pid}"));
        let most = worst.drops.min(overflows);
        return Finding::warning(
            CHECK,
            format!("{}{pid} lost up to {most} messages: its buffer was full", name(worst)),
        )
        .why("It is too slow, too seldom scheduled, or its receive buffer too small; see recv_buf_size above.")
        .cure(match &worst.program {
            Some((_, pid)) => format!("top -Hp {pid}"),
            None => "sudo advee doctor   # tells which program".into(),
        });
    }
    let users: BTreeSet<u32> = listeners.iter().map(|listener| listener.uid).collect();
    if users.len() > 1 {
        let list: Vec<String> = users.iter().map(ToString::to_string).collect();
        return Finding::warning(CHECK, format!("of users {} on one bus: {}", list.join(", "), names.join(", ")))
            .why("All of them can command the robot, and shared memory works between programs of one user only.")
            .cure("ps -o user,pid,args -C advee");
    }
    let lost = if overflows == 0 { "; none lost a message" } else { "" };
    Finding::ok(CHECK, format!("{}: {}{lost}", listeners.len(), names.join(", ")))
}
