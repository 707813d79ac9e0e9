//! A fixed table of deadlines: one optional instant for each name of a small enum.

use crate::{Duration, Instant};
use core::fmt;

/// The name of a deadline in a [`Deadlines`] table: a small enum without fields, made by
/// [`deadlines!`](crate::deadlines).
pub trait Key: Copy + fmt::Debug + 'static {
    /// One [`Instant`] for each name.
    type Table: AsRef<[Instant]> + AsMut<[Instant]> + Clone + Copy;
    /// All names, in the order of the enum.
    const ALL: &'static [Self];
    /// The table in which nothing is due: all [`Instant::NEVER`].
    const EMPTY: Self::Table;

    /// Position of this name in [`Key::ALL`] and in the table.
    fn index(self) -> usize;
}

/// Declares an enum without fields as the [`Key`] of a [`Deadlines`] table.
///
/// ```
/// base::deadlines! {
///     /// Deadlines of a lamp.
///     #[derive(PartialEq)]
///     pub enum Timer {
///         /// The lamp goes out.
///         Off,
///         /// The battery is measured.
///         Measure,
///     }
/// }
/// assert_eq!(<Timer as base::Key>::ALL, [Timer::Off, Timer::Measure]);
/// ```
#[macro_export]
macro_rules! deadlines {
    ($(#[$attribute:meta])* $visibility:vis enum $name:ident { $($(#[$comment:meta])* $key:ident),+ $(,)? }) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug)]
        $visibility enum $name {
            $($(#[$comment])* $key,)+
        }

        impl $crate::Key for $name {
            type Table = [$crate::Instant; [$($name::$key),+].len()];
            const ALL: &'static [Self] = &[$($name::$key),+];
            const EMPTY: Self::Table = [$crate::Instant::NEVER; [$($name::$key),+].len()];

            fn index(self) -> usize {
                self as usize
            }
        }
    };
}

/// The deadlines of a state machine, at most one for each name of the enum `K`.
///
/// `poll_timeout` is [`Deadlines::next`], the minimum over the table: a deadline that is not in the table does not
/// exist, and one that is cannot be forgotten. What fires reads the same table, by [`Deadlines::take`] or
/// [`Deadlines::tick`]; afterwards it is in the future or absent, so that nothing is due twice.
///
/// Suits deadlines that outlive states. The deadline of one state belongs into the state; those of a part belong to the
/// part, and [`earliest`] joins them.
///
/// ```
/// use base::{Deadlines, Duration, Instant};
///
/// base::deadlines! {
///     /// Deadlines of a lamp with a switch-off delay.
///     enum Timer {
///         /// The lamp goes out.
///         Off,
///         /// The battery is measured.
///         Measure,
///     }
/// }
///
/// const ON_FOR: Duration = Duration::from_secs(30);
/// const MEASURE: Duration = Duration::from_secs(10);
///
/// struct Lamp {
///     lit: bool,
///     measurements: u32,
///     deadlines: Deadlines<Timer>,
/// }
///
/// impl Lamp {
///     fn new(now: Instant) -> Self {
///         Self { lit: false, measurements: 0, deadlines: Deadlines::new().with(Timer::Measure, now + MEASURE) }
///     }
///
///     fn press(&mut self, now: Instant) {
///         self.lit = true;
///         self.deadlines.set(Timer::Off, now + ON_FOR);
///     }
///
///     fn handle_timeout(&mut self, now: Instant) {
///         if self.deadlines.take(Timer::Off, now) {
///             self.lit = false;
///         }
///         if self.deadlines.tick(Timer::Measure, now, MEASURE) {
///             self.measurements += 1;
///         }
///     }
///
///     fn poll_timeout(&self) -> Option<Instant> {
///         self.deadlines.next()
///     }
/// }
///
/// let mut lamp = Lamp::new(Instant::ZERO);
/// lamp.press(Instant::ZERO);
/// while lamp.lit {
///     let now = lamp.poll_timeout().expect("it measures for ever");
///     lamp.handle_timeout(now);
/// }
/// assert_eq!(lamp.measurements, 3);
/// assert_eq!(lamp.poll_timeout(), Some(Instant::ZERO + Duration::from_secs(40)));
/// ```
#[derive(Clone, Copy)]
pub struct Deadlines<K: Key>(K::Table);

impl<K: Key> Deadlines<K> {
    /// A table without deadlines.
    #[must_use]
    pub const fn new() -> Self {
        Self(K::EMPTY)
    }

    /// The table with `key` due at `at` too.
    #[must_use]
    pub fn with(mut self, key: K, at: Instant) -> Self {
        self.set(key, at);
        self
    }

    /// Makes `key` due at `at`, in place of an earlier deadline; at [`Instant::NEVER`] the same as [`Self::clear`].
    pub fn set(&mut self, key: K, at: Instant) {
        self.0.as_mut()[key.index()] = at;
    }

    /// Makes `key` due at `at`, or at no time.
    pub fn replace(&mut self, key: K, at: Option<Instant>) {
        self.set(key, at.unwrap_or(Instant::NEVER));
    }

    /// Removes the deadline of `key`.
    pub fn clear(&mut self, key: K) {
        self.set(key, Instant::NEVER);
    }

    /// Removes all deadlines.
    pub fn clear_all(&mut self) {
        self.0 = K::EMPTY;
    }

    /// The deadline of `key`.
    #[must_use]
    pub fn get(&self, key: K) -> Option<Instant> {
        Some(self.0.as_ref()[key.index()]).filter(|at| *at != Instant::NEVER)
    }

    /// True if `key` has a deadline, past or future.
    #[must_use]
    pub fn is_set(&self, key: K) -> bool {
        self.get(key).is_some()
    }

    /// The earliest deadline: what `poll_timeout` returns.
    #[must_use]
    pub fn next(&self) -> Option<Instant> {
        self.0.as_ref().iter().min().copied().filter(|at| *at != Instant::NEVER)
    }

    /// The earliest deadline after `now`, for tables in which deadlines that have come stay.
    #[must_use]
    pub fn next_after(&self, now: Instant) -> Option<Instant> {
        self.0.as_ref().iter().filter(|at| **at > now && **at != Instant::NEVER).min().copied()
    }

    /// True if the deadline of `key` has come; it stays in the table.
    #[must_use]
    pub fn is_due(&self, key: K, now: Instant) -> bool {
        self.get(key).is_some_and(|at| at <= now)
    }

    /// All names whose deadline has come, in the order of the enum; they stay in the table.
    pub fn expired(&self, now: Instant) -> impl Iterator<Item = K> {
        K::ALL.iter().copied().filter(move |key| self.is_due(*key, now))
    }

    /// True once when the deadline of `key` has come; removes it.
    pub fn take(&mut self, key: K, now: Instant) -> bool {
        let due = self.is_due(key, now);
        if due {
            self.clear(key);
        }
        due
    }

    /// The first name, in the order of the enum, whose deadline has come; removes that deadline.
    pub fn pop(&mut self, now: Instant) -> Option<K> {
        let key = self.expired(now).next()?;
        self.clear(key);
        Some(key)
    }

    /// True once per deadline of `key` that has come; the next is the first after `now` on the grid of `period` (at
    /// least 1 ns), so that periodic work keeps its phase and drops what it missed. Without a deadline nothing is due.
    pub fn tick(&mut self, key: K, now: Instant, period: Duration) -> bool {
        let Some(at) = self.get(key).filter(|at| *at <= now) else {
            return false;
        };
        self.set(key, at.next_on_grid(now, period));
        true
    }
}

impl<K: Key> Default for Deadlines<K> {
    fn default() -> Self {
        Self::new()
    }
}

impl<K: Key> fmt::Debug for Deadlines<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let set = K::ALL.iter().filter_map(|key| self.get(*key).map(|at| (key, at)));
        f.debug_map().entries(set).finish()
    }
}

/// The earliest of some deadlines: joins those of a state machine with those of its parts.
#[must_use]
pub fn earliest<const N: usize>(deadlines: [Option<Instant>; N]) -> Option<Instant> {
    // By reference: an array's own iterator moves all of it first, and hosts ask after every event.
    deadlines.iter().flatten().min().copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Ticker;
    use alloc::format;
    use alloc::vec::Vec;

    crate::deadlines! {
        #[derive(PartialEq, Eq, PartialOrd, Ord)]
        enum Timer {
            Reply,
            Announce,
            Silence,
        }
    }

    use Timer::{Announce, Reply, Silence};

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    #[test]
    fn the_next_deadline_is_the_earliest_in_the_table() {
        let mut table = Deadlines::<Timer>::new();
        assert_eq!(table.next(), None);
        table.set(Silence, at(30));
        table.set(Reply, at(50));
        assert_eq!(table.next(), Some(at(30)));
        table.set(Silence, at(70));
        assert_eq!((table.next(), table.get(Silence)), (Some(at(50)), Some(at(70))));
        table.clear(Reply);
        assert_eq!((table.next(), table.is_set(Reply), table.is_set(Silence)), (Some(at(70)), false, true));
        table.clear_all();
        assert_eq!(table.next(), None);
    }

    #[test]
    fn a_deadline_that_never_comes_is_absent() {
        let mut table = Deadlines::new().with(Reply, at(1));
        table.set(Reply, Instant::NEVER);
        assert_eq!((table.get(Reply), table.next()), (None, None));
        assert!(!table.is_due(Reply, Instant::NEVER) && !table.take(Reply, Instant::NEVER));
        assert!(!table.tick(Reply, Instant::NEVER, Duration::from_secs(1)));
        table.replace(Reply, Some(at(2)));
        assert_eq!(table.next(), Some(at(2)));
        table.replace(Reply, None);
        assert_eq!(table.next(), None);
    }

    #[test]
    fn what_has_come_is_taken_once_and_in_the_order_of_the_enum() {
        let mut table = Deadlines::new().with(Silence, at(10)).with(Reply, at(20)).with(Announce, at(30));
        assert_eq!(table.pop(at(9)), None);
        assert_eq!(table.expired(at(20)).collect::<Vec<_>>(), [Reply, Silence]);
        assert_eq!((table.pop(at(20)), table.pop(at(20)), table.pop(at(20))), (Some(Reply), Some(Silence), None));
        assert!(!table.take(Announce, at(29)));
        assert!(table.take(Announce, at(30)));
        assert!(!table.take(Announce, at(30)));
    }

    #[test]
    fn a_table_is_shown_by_its_names() {
        let table = Deadlines::new().with(Announce, at(1));
        assert_eq!(format!("{table:?}"), "{Announce: 0.001000000 s}");
    }

    #[test]
    fn the_earliest_of_nothing_is_nothing() {
        assert_eq!(earliest([None, None]), None);
        assert_eq!(earliest([None, Some(at(3)), Some(at(2))]), Some(at(2)));
    }

    /// Against a sorted list of pairs and a [`Ticker`] for each periodic name, over random calls.
    #[test]
    fn a_table_does_what_a_list_of_deadlines_does() {
        const KEYS: [Timer; 3] = [Reply, Announce, Silence];
        let mut seed = 0x9E37_79B9_7F4A_7C15_u64;
        let mut random = |below: u64| {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            seed % below
        };
        for _ in 0..300 {
            let mut table = Deadlines::<Timer>::new();
            let mut list: Vec<(Timer, Instant)> = Vec::new();
            let mut now = Instant::ZERO;
            for _ in 0..200 {
                let key = KEYS[random(3) as usize];
                let listed = list.iter().position(|(name, _)| *name == key);
                let due = listed.is_some_and(|i| list[i].1 <= now);
                match random(7) {
                    0 => now += Duration::from_nanos(random(30)),
                    1 => {
                        let at = now + Duration::from_nanos(random(50)) - Duration::from_nanos(random(20));
                        table.set(key, at);
                        list.retain(|(name, _)| *name != key);
                        list.push((key, at));
                    }
                    2 => {
                        table.clear(key);
                        list.retain(|(name, _)| *name != key);
                    }
                    3 => {
                        assert_eq!(table.take(key, now), due);
                        list.retain(|(name, _)| *name != key || !due);
                    }
                    4 => {
                        let period = Duration::from_nanos(random(12));
                        let ticked = listed.is_some_and(|i| {
                            let mut ticker = Ticker::new(list[i].1, period);
                            let ticked = ticker.due(now);
                            list[i].1 = ticker.next();
                            ticked
                        });
                        assert_eq!(table.tick(key, now, period), ticked);
                        assert!(!table.tick(key, now, period), "due once");
                    }
                    5 => {
                        let mut expired: Vec<Timer> =
                            list.iter().filter(|(_, at)| *at <= now).map(|(name, _)| *name).collect();
                        expired.sort();
                        assert_eq!(table.expired(now).collect::<Vec<_>>(), expired);
                        assert_eq!(table.pop(now), expired.first().copied());
                        list.retain(|(name, _)| Some(name) != expired.first());
                    }
                    _ => {
                        while table.pop(now).is_some() {
                            list.retain(|(name, _)| table.is_set(*name));
                        }
                    }
                }
                assert_eq!(table.next(), list.iter().map(|(_, at)| *at).min());
                assert_eq!(table.next_after(now), list.iter().map(|(_, at)| *at).filter(|at| *at > now).min());
                for key in KEYS {
                    let listed = list.iter().find(|(name, _)| *name == key);
                    assert_eq!(table.get(key), listed.map(|(_, at)| *at));
                }
            }
        }
    }
}
