//! Heartbeat to the lifecycle manager of Nav2 (`bond/msg/Status` of bond_core 4.1): a manager that does not hear it for
//! its `bond_timeout` takes the node for dead, and deactivates the others. The manager's own heartbeat is not awaited,
//! as no node of Nav2 does.

use crate::topics::{Quality, Topic};
use base::{Duration, Instant};
use lcm_gen::cdr::Writer;

/// Period of the heartbeat; the manager waits for 4 s, and half of it for the first one.
const PERIOD: Duration = Duration::from_millis(250);
/// What a manager usually waits, s; it is only shown.
const TIMEOUT_S: f32 = 4.0;

/// The node's end of the bond.
#[derive(Clone, Debug)]
pub struct Bond {
    /// Name of the bond: that of the node.
    name: String,
    /// Identifier of this end.
    instance: String,
    due: Option<Instant>,
}

impl Bond {
    /// A bond that has not begun. `instance` is an identifier that no other program has.
    #[must_use]
    pub fn new(name: &str, instance: String) -> Self {
        Self { name: name.to_owned(), instance, due: None }
    }

    /// Its topic, below the namespace of the node.
    #[must_use]
    pub fn topic() -> Topic {
        Topic::new("/bond", "bond/msg/Status", Quality::Reliable)
    }

    /// The message that is due, at the time `now` and `micros` since the UNIX epoch. `holds`: the node is active; when
    /// it is no more, one message says that the bond is broken.
    pub fn poll(&mut self, now: Instant, micros: i64, holds: bool) -> Option<Vec<u8>> {
        match (self.due, holds) {
            (None, false) => return None,
            (Some(due), true) if now < due => return None,
            _ => self.due = holds.then_some(now + PERIOD),
        }
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        to.i32(micros.div_euclid(1_000_000) as i32);
        to.u32((micros.rem_euclid(1_000_000) * 1000) as u32);
        to.string("");
        to.string(&self.name);
        to.string(&self.instance);
        to.bool(holds);
        to.f32(TIMEOUT_S);
        to.f32(PERIOD.as_secs_f32());
        Some(cdr)
    }

    /// When [`poll`](Self::poll) is to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.due
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Reader;

    #[test]
    fn the_heartbeat_comes_while_the_node_is_active_and_its_end_is_said_once() {
        let mut bond = Bond::new("courier", "abc".into());
        let mut active = Vec::new();
        for millis in 0..2000 {
            let holds = (500..1200).contains(&millis);
            let Some(cdr) = bond.poll(Instant::from_millis(millis), 1_500_000, holds) else { continue };
            let mut reader = Reader::new(&cdr).unwrap();
            assert_eq!((reader.i32(), reader.u32(), reader.string()), (Some(1), Some(500_000_000), Some("")));
            assert_eq!((reader.string(), reader.string()), (Some("courier"), Some("abc")));
            active.push((millis, reader.bool().unwrap()));
            assert_eq!((reader.u32().map(f32::from_bits), reader.u32().map(f32::from_bits)), (Some(4.0), Some(0.25)));
        }
        assert_eq!(active, [(500, true), (750, true), (1000, true), (1200, false)]);
    }
}
