//! Identity and roles of users: the codes that pair a device, the sessions of paired ones.
//!
//! Pure: time and randomness are passed in. [`super::session_store`] has the clock and the files.

use base::{Duration, Instant};
use serde::{Deserialize, Serialize, Serializer};
use std::fmt::Write;
use std::sync::Arc;

/// Role of a user; each includes those before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// The page itself, and pairing; no part of the view.
    #[default]
    Nobody,
    /// May view.
    Viewer,
    /// May drive.
    Operator,
    /// May do everything.
    Engineer,
}

/// User of a request, attached to each request that the guard accepts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Who {
    /// Role.
    pub role: Role,
    /// Name given when pairing; empty if not paired.
    pub name: Arc<str>,
    /// The paired device's number.
    pub device: Option<u32>,
}

/// Random bytes for one pairing: the session's key, and the next code.
pub type Chance = [u8; 32];

/// Time without use after which a session ends.
pub const IDLE_MAX: Duration = Duration::from_secs(12 * 3600);
/// Maximum number of sessions; a further one replaces the least recently used.
pub const SESSIONS_MAX: usize = 32;
/// Maximum length of a name, characters.
pub const NAME_MAX: usize = 40;
/// Number of wrong codes after which new codes are made.
const WRONG_MAX: u32 = 10;
/// Maximum number of tries within `TRIES_TIME`, by all devices together.
const TRIES_MAX: usize = 10;
const TRIES_TIME: Duration = Duration::from_secs(60);
/// Number of codes: eight digits.
const CODES: u64 = 100_000_000;

/// Reason for a refused pairing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The name has no visible character, or too many.
    Name,
    /// Wrong code.
    Wrong,
    /// Too many recent attempts.
    TooMany,
}

impl Refused {
    /// Explanation for the user.
    #[must_use]
    pub const fn why(self) -> &'static str {
        match self {
            Self::Name => "a name has 1 to 40 characters",
            Self::Wrong => "this is not a code that the robot's console shows now",
            Self::TooMany => "too many have tried: wait a minute",
        }
    }
}

/// Codes that pair a device, shown only at the robot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Codes {
    /// Code of an operator, eight digits.
    pub operator: String,
    /// Code of an engineer, eight different digits.
    pub engineer: String,
}

impl Codes {
    /// Creates two different codes.
    #[must_use]
    pub fn new(chance: &Chance) -> Self {
        let operator = code(chance, 0, "");
        Self { engineer: code(chance, 8, &operator), operator }
    }

    /// Role of a code, compared in constant time.
    fn role(&self, given: &str) -> Option<Role> {
        let [operator, engineer] =
            [&self.operator, &self.engineer].map(|code| is_same(given.as_bytes(), code.as_bytes()));
        match (operator, engineer) {
            (_, true) => Some(Role::Engineer),
            (true, false) => Some(Role::Operator),
            (false, false) => None,
        }
    }
}

/// Eight digits derived from the random bytes from `at` on, different from `not`.
fn code(chance: &Chance, at: usize, not: &str) -> String {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&chance[at..at + 8]);
    let number = u64::from_le_bytes(bytes) % CODES;
    let code = format!("{number:08}");
    if code == not { format!("{:08}", (number + 1) % CODES) } else { code }
}

/// A paired device, as stored and shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Session {
    /// Number; never reused.
    pub id: u32,
    /// Key in its cookie: 32 hexadecimal digits.
    pub key: String,
    /// Name that it gave itself.
    pub name: Arc<str>,
    /// Role.
    pub role: Role,
    /// Time of last use.
    pub used: Instant,
    /// Number of open sockets.
    connected: u32,
}

impl Session {
    /// Restores a stored session.
    #[must_use]
    pub fn kept(id: u32, key: String, name: &str, role: Role, used: Instant) -> Self {
        Self { id, key, name: name.into(), role, used, connected: 0 }
    }

    fn who(&self) -> Who {
        Who { role: self.role, name: self.name.clone(), device: Some(self.id) }
    }

    fn idle(&self, now: Instant) -> Duration {
        if self.connected > 0 { Duration::ZERO } else { now.since(self.used) }
    }

    /// True if a stored session is valid.
    fn is_good(&self) -> bool {
        let hexadecimal = self.key.len() == 32 && self.key.bytes().all(|byte| byte.is_ascii_hexdigit());
        hexadecimal && self.role >= Role::Operator && clean(&self.name).as_deref() == Some(&*self.name)
    }
}

/// A paired device, as listed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Device {
    /// Number.
    pub id: u32,
    /// Name that it gave itself.
    #[serde(serialize_with = "text")]
    pub name: Arc<str>,
    /// Role.
    pub role: Role,
    /// Time since its last use, s.
    pub idle: f64,
    /// True if it has an open socket.
    pub connected: bool,
    /// True for the requesting device itself.
    pub you: bool,
}

/// All paired devices, and the codes for further ones.
#[derive(Debug)]
pub struct Access {
    codes: Codes,
    /// Number of wrong codes since the last renewal.
    wrong: u32,
    /// Times of the last attempts, oldest first.
    tries: Vec<Instant>,
    sessions: Vec<Session>,
    next: u32,
}

impl Access {
    /// Restores the sessions of an earlier run; invalid ones are dropped.
    #[must_use]
    pub fn new(now: Instant, codes: Codes, kept: Vec<Session>) -> Self {
        let mut access = Self { codes, wrong: 0, tries: Vec::with_capacity(TRIES_MAX), sessions: Vec::new(), next: 1 };
        for session in kept {
            let known = access.sessions.iter().any(|other| other.id == session.id || other.key == session.key);
            if session.is_good() && !known && access.sessions.len() < SESSIONS_MAX {
                access.next = access.next.max(session.id.saturating_add(1));
                access.sessions.push(session);
            }
        }
        access.expire(now);
        access
    }

    /// Current codes.
    #[must_use]
    pub fn codes(&self) -> &Codes {
        &self.codes
    }

    /// All paired devices.
    #[must_use]
    pub fn sessions(&self) -> &[Session] {
        &self.sessions
    }

    /// Pairs a device; returns its key for the cookie, and its identity.
    ///
    /// # Errors
    /// Reason of the refusal. Wrong codes are counted; after too many the codes are renewed.
    pub fn pair(&mut self, now: Instant, code: &str, name: &str, chance: &Chance) -> Result<(String, Who), Refused> {
        let name = clean(name).ok_or(Refused::Name)?;
        self.tries.retain(|at| now.since(*at) < TRIES_TIME);
        if self.tries.len() >= TRIES_MAX {
            return Err(Refused::TooMany);
        }
        self.tries.push(now);
        let digits: String = code.chars().filter(|c| !c.is_whitespace()).take(9).collect();
        let Some(role) = self.codes.role(&digits) else {
            self.wrong += 1;
            if self.wrong >= WRONG_MAX {
                self.codes = Codes::new(chance);
                self.wrong = 0;
            }
            return Err(Refused::Wrong);
        };
        let Codes { operator, engineer } = &mut self.codes;
        match role {
            Role::Engineer => *engineer = self::code(chance, 16, operator),
            _ => *operator = self::code(chance, 16, engineer),
        }
        self.wrong = 0;
        self.expire(now);
        while self.sessions.len() >= SESSIONS_MAX {
            let unused = (0..self.sessions.len()).max_by_key(|index| self.sessions[*index].idle(now)).unwrap_or(0);
            self.sessions.remove(unused);
        }
        let mut key = String::with_capacity(32);
        for byte in chance[..8].iter().chain(&chance[24..]) {
            let _ = write!(key, "{byte:02x}");
        }
        let session = Session::kept(self.next, key.clone(), &name, role, now);
        self.next = self.next.saturating_add(1);
        let who = session.who();
        self.sessions.push(session);
        Ok((key, who))
    }

    /// User of a session key; updates the time of last use.
    pub fn who(&mut self, now: Instant, key: &str) -> Option<Who> {
        self.expire(now);
        let mut found = None;
        for session in &mut self.sessions {
            if is_same(key.as_bytes(), session.key.as_bytes()) {
                session.used = now;
                found = Some(session.who());
            }
        }
        found
    }

    /// True if a device is still paired.
    #[must_use]
    pub fn is_paired(&self, device: u32) -> bool {
        self.sessions.iter().any(|session| session.id == device)
    }

    /// Counts another socket of a device.
    pub fn connect(&mut self, device: u32) {
        if let Some(session) = self.of(device) {
            session.connected = session.connected.saturating_add(1);
        }
    }

    /// Counts the end of a socket.
    pub fn disconnect(&mut self, now: Instant, device: u32) {
        if let Some(session) = self.of(device) {
            session.connected = session.connected.saturating_sub(1);
            session.used = now;
        }
    }

    /// Ends a session; true if it existed.
    pub fn forget(&mut self, device: u32) -> bool {
        let before = self.sessions.len();
        self.sessions.retain(|session| session.id != device);
        self.sessions.len() < before
    }

    /// All paired devices, for the engineer who requests the list.
    #[must_use]
    pub fn devices(&self, now: Instant, asking: Option<u32>) -> Vec<Device> {
        let row = |session: &Session| Device {
            id: session.id,
            name: session.name.clone(),
            role: session.role,
            idle: session.idle(now).as_secs_f64(),
            connected: session.connected > 0,
            you: asking == Some(session.id),
        };
        self.sessions.iter().map(row).collect()
    }

    fn of(&mut self, device: u32) -> Option<&mut Session> {
        self.sessions.iter_mut().find(|session| session.id == device)
    }

    fn expire(&mut self, now: Instant) {
        self.sessions.retain(|session| session.idle(now) < IDLE_MAX);
    }
}

/// Compares secrets in constant time.
pub fn is_same(given: &[u8], token: &[u8]) -> bool {
    given.len() == token.len() && given.iter().zip(token).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// Serializes a shared text.
pub fn text<S: Serializer>(text: &Arc<str>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(text)
}

/// Name without invisible characters and with single blanks; `None` if it becomes empty or is too long.
#[must_use]
pub fn clean(name: &str) -> Option<String> {
    // Marks that reverse the direction of writing or join characters would make names look alike.
    let unseen = |c: char| {
        c.is_control()
            || matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{feff}')
            || ('\u{200b}'..='\u{200f}').contains(&c)
            || ('\u{2028}'..='\u{202e}').contains(&c)
            || ('\u{2060}'..='\u{206f}').contains(&c)
            || ('\u{e0000}'..='\u{e007f}').contains(&c)
    };
    let words: Vec<String> = name
        .split_whitespace()
        .map(|word| word.chars().filter(|c| !unseen(*c)).collect::<String>())
        .filter(|word| !word.is_empty())
        .collect();
    let name = words.join(" ");
    (1..=NAME_MAX).contains(&name.chars().count()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: u64) -> Instant {
        Instant::from_millis(100_000_000 + seconds * 1000)
    }

    /// Different random bytes for each number.
    fn chance(number: u8) -> Chance {
        std::array::from_fn(|index| number.wrapping_mul(37).wrapping_add((index as u8).wrapping_mul(11)))
    }

    fn fresh() -> Access {
        Access::new(at(0), Codes::new(&chance(1)), Vec::new())
    }

    #[test]
    fn roles_match_the_page_in_order_and_names() {
        assert!(Role::Nobody < Role::Viewer && Role::Viewer < Role::Operator && Role::Operator < Role::Engineer);
        assert_eq!(serde_json::to_string(&Role::Engineer).unwrap(), "\"engineer\"");
    }

    #[test]
    fn a_code_pairs_once_and_makes_its_role() {
        let mut access = fresh();
        let Codes { operator, engineer } = access.codes().clone();
        assert!(operator != engineer && operator.len() == 8 && engineer.bytes().all(|byte| byte.is_ascii_digit()));
        let spaced = format!(" {} {}\n", &operator[..4], &operator[4..]);
        let (key, who) = access.pair(at(1), &spaced, "phone", &chance(2)).unwrap();
        assert_eq!((who.role, &*who.name, who.device), (Role::Operator, "phone", Some(1)));
        assert_eq!(access.who(at(2), &key), Some(who));
        assert_eq!(access.pair(at(3), &operator, "other", &chance(3)).unwrap_err(), Refused::Wrong);
        assert_eq!(access.codes().engineer, engineer, "the other code stays");
        let (second, who) = access.pair(at(4), &engineer, "desk", &chance(4)).unwrap();
        assert_eq!((who.role, who.device), (Role::Engineer, Some(2)));
        assert!(second != key && second.len() == 32 && access.codes().engineer != engineer);
    }

    #[test]
    fn ten_wrong_codes_renew_the_codes_and_attempts_are_limited() {
        let mut access = fresh();
        let codes = access.codes().clone();
        for number in 0..10 {
            let tried = if number % 2 == 0 { "" } else { "123456789" };
            assert_eq!(access.codes(), &codes);
            assert_eq!(access.pair(at(number), tried, "x", &chance(number as u8)).unwrap_err(), Refused::Wrong);
        }
        let codes = access.codes().clone();
        assert_ne!(codes, Codes::new(&chance(1)));
        let try_at = |access: &mut Access, second| access.pair(at(second), &codes.operator, "x", &chance(9));
        assert_eq!(try_at(&mut access, 59).unwrap_err(), Refused::TooMany, "the right one too");
        assert!(try_at(&mut access, 60).is_ok(), "the first is a minute old");
    }

    #[test]
    fn names_have_visible_characters_only() {
        assert_eq!(clean("  Jan\t K.\n").as_deref(), Some("Jan K."));
        assert_eq!(clean("\u{202e}nimda\u{0}").as_deref(), Some("nimda"));
        assert_eq!(clean(&"ž".repeat(40)), Some("ž".repeat(40)));
        for none in ["", " ", "\u{200b}", &"x".repeat(41)] {
            assert_eq!(clean(none), None, "{none:?}");
        }
        let mut access = fresh();
        let code = access.codes().operator.clone();
        assert_eq!(access.pair(at(0), &code, "\u{7}", &chance(2)).unwrap_err(), Refused::Name);
        assert!(access.pair(at(0), &code, "x", &chance(2)).is_ok(), "the code is not used up");
    }

    #[test]
    fn a_session_that_is_unused_ends_and_one_with_a_socket_does_not() {
        let mut access = fresh();
        let code = access.codes().operator.clone();
        let (key, _) = access.pair(at(0), &code, "x", &chance(2)).unwrap();
        assert!(access.who(at(12 * 3600 - 1), &key).is_some());
        access.connect(1);
        assert!(access.who(at(48 * 3600), &key).is_some());
        assert!(access.devices(at(60 * 3600), Some(1))[0].connected);
        access.disconnect(at(60 * 3600), 1);
        assert_eq!(access.who(at(72 * 3600), &key), None);
        assert_eq!(access.who(at(0), ""), None);
    }

    #[test]
    fn the_least_recently_used_session_is_dropped_and_one_can_be_removed() {
        let mut access = fresh();
        for number in 0..40_u64 {
            let code = access.codes().operator.clone();
            access.pair(at(number * 100), &code, "x", &chance(number as u8 + 2)).unwrap();
            if number == 0 {
                access.connect(1);
            }
        }
        let ids: Vec<u32> = access.sessions().iter().map(|session| session.id).collect();
        assert_eq!((ids.len(), ids[0], ids[1]), (SESSIONS_MAX, 1, 10), "the first has a socket");
        assert!(access.forget(20) && !access.forget(20) && !access.is_paired(20));
        assert_eq!(access.devices(at(4000), Some(40)).iter().filter(|device| device.you).count(), 1);
    }

    #[test]
    fn stored_sessions_are_restored_if_valid() {
        let good = Session::kept(7, "0123456789abcdef0123456789abcdef".into(), "phone", Role::Operator, at(0));
        let kept = vec![
            good.clone(),
            Session { role: Role::Viewer, id: 8, ..good.clone() },
            Session { key: "x".repeat(32), id: 9, ..good.clone() },
            Session { id: 10, ..good.clone() },
            Session { name: " ".into(), id: 11, key: "f".repeat(32), ..good.clone() },
        ];
        let mut access = Access::new(at(10), Codes::new(&chance(1)), kept);
        assert_eq!(access.sessions(), std::slice::from_ref(&good));
        let code = access.codes().operator.clone();
        let (_, who) = access.pair(at(11), &code, "x", &chance(2)).unwrap();
        assert_eq!(who.device, Some(8), "no number is given twice");
        assert!(Access::new(at(13 * 3600), Codes::new(&chance(1)), vec![good]).sessions().is_empty());
    }
}
