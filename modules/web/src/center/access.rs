//! Identity and roles of users: the codes that pair a device, the sessions of paired ones.
//!
//! Pure: time and randomness are passed in. [`super::session_store`] has the clock and the files.

use super::sha256;
use base::{Duration, Instant};
use serde::{Deserialize, Serialize, Serializer};
use std::fmt::Write;
use std::net::IpAddr;
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

/// Random bytes for one pairing, or for two codes.
pub type Chance = [u8; 32];

/// Time without use after which a session ends.
pub const IDLE_MAX: Duration = Duration::from_secs(12 * 3600);
/// Maximum number of sessions; a further one replaces the least recently used.
pub const SESSIONS_MAX: usize = 32;
/// Maximum length of a name, characters.
pub const NAME_MAX: usize = 40;
/// Time for which a code pairs.
pub const CODE_TTL: Duration = Duration::from_secs(600);
/// A code is shown again on request only if it remains valid for at least this long.
const CODE_LEFT_MIN: Duration = Duration::from_secs(300);
/// Maximum number of wrong codes within `WRONG_TIME`: from one address, and from all.
const WRONG_MAX: usize = 10;
const WRONG_ALL_MAX: usize = 60;
const WRONG_TIME: Duration = Duration::from_secs(60);
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
            Self::Wrong => "this is not a code that pairs now: `advee web code` on the robot's computer shows one",
            Self::TooMany => "too many have tried: wait a minute",
        }
    }
}

/// Codes that pair a device, made on demand and shown only at the robot; an operator's also to an engineer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Codes {
    /// Code of an operator, eight digits.
    pub operator: String,
    /// Code of an engineer, eight different digits.
    pub engineer: String,
    /// Time for which both pair.
    pub valid: Duration,
}

/// A code, and the end of its validity.
#[derive(Clone, Debug)]
struct Code {
    digits: String,
    until: Instant,
}

impl Code {
    /// True if it may be shown again.
    fn lasts(&self, now: Instant) -> bool {
        self.until.since(now) >= CODE_LEFT_MIN
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
    /// Digest of the key in its cookie: 64 hexadecimal digits.
    pub digest: String,
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
    pub fn kept(id: u32, digest: String, name: &str, role: Role, used: Instant) -> Self {
        Self { id, digest, name: name.into(), role, used, connected: 0 }
    }

    fn who(&self) -> Who {
        Who { role: self.role, name: self.name.clone(), device: Some(self.id) }
    }

    fn idle(&self, now: Instant) -> Duration {
        if self.connected > 0 { Duration::ZERO } else { now.since(self.used) }
    }

    /// True if a stored session is valid.
    fn is_good(&self) -> bool {
        let hexadecimal = self.digest.len() == 64 && self.digest.bytes().all(|byte| byte.is_ascii_hexdigit());
        hexadecimal && self.role >= Role::Operator && clean(&self.name).as_deref() == Some(&*self.name)
    }
}

/// A paired device. `GET /api/devices` (engineer): all.
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
#[derive(Debug, Default)]
pub struct Access {
    operator: Option<Code>,
    engineer: Option<Code>,
    /// Wrong codes of the last [`WRONG_TIME`]: address and time, oldest first.
    wrong: Vec<(IpAddr, Instant)>,
    sessions: Vec<Session>,
    next: u32,
}

impl Access {
    /// Restores the sessions of an earlier run; invalid ones are dropped.
    #[must_use]
    pub fn new(now: Instant, kept: Vec<Session>) -> Self {
        let mut access = Self { next: 1, ..Self::default() };
        for session in kept {
            let known = access.sessions.iter().any(|other| other.id == session.id || other.digest == session.digest);
            if session.is_good() && !known && access.sessions.len() < SESSIONS_MAX {
                access.next = access.next.max(session.id.saturating_add(1));
                access.sessions.push(session);
            }
        }
        access.expire(now);
        access
    }

    /// Codes for further devices; new ones unless the present ones remain valid for some minutes.
    pub fn codes(&mut self, now: Instant, chance: &Chance) -> Codes {
        let (operator, operator_valid) = self.operator_code(now, chance);
        let engineer = self.engineer.take().filter(|code| code.lasts(now));
        let until = now + CODE_TTL;
        let engineer = engineer.unwrap_or_else(|| Code { digits: code(chance, 8, &operator), until });
        let valid = operator_valid.min(engineer.until.since(now));
        let codes = Codes { operator, engineer: engineer.digits.clone(), valid };
        self.engineer = Some(engineer);
        codes
    }

    /// Code for a further operator's device, and the time for which it pairs; a new one under the same condition.
    pub fn operator_code(&mut self, now: Instant, chance: &Chance) -> (String, Duration) {
        let present = self.operator.take().filter(|code| code.lasts(now));
        let taken = self.engineer.as_ref().map_or("", |code| &code.digits);
        let operator = present.unwrap_or_else(|| Code { digits: code(chance, 0, taken), until: now + CODE_TTL });
        let answer = (operator.digits.clone(), operator.until.since(now));
        self.operator = Some(operator);
        answer
    }

    /// All paired devices.
    #[must_use]
    pub fn sessions(&self) -> &[Session] {
        &self.sessions
    }

    /// Pairs a device that asks from an address; returns its key for the cookie, and its identity. A code pairs once.
    ///
    /// # Errors
    /// Reason of the refusal. After too many wrong codes from one address, that address is refused for a minute; only
    /// after a flood from many addresses are all refused.
    pub fn pair(
        &mut self,
        now: Instant,
        from: IpAddr,
        code: &str,
        name: &str,
        chance: &Chance,
    ) -> Result<(String, Who), Refused> {
        let name = clean(name).ok_or(Refused::Name)?;
        self.wrong.retain(|(_, at)| now.since(*at) < WRONG_TIME);
        let own = self.wrong.iter().filter(|(other, _)| *other == from).count();
        if own >= WRONG_MAX || self.wrong.len() >= WRONG_ALL_MAX {
            return Err(Refused::TooMany);
        }
        let digits: String = code.chars().filter(|c| !c.is_whitespace()).take(9).collect();
        // Both are compared, in constant time.
        let [operator, engineer] = [&self.operator, &self.engineer].map(|code| {
            code.as_ref().is_some_and(|code| now < code.until && is_same(digits.as_bytes(), code.digits.as_bytes()))
        });
        let role = match (operator, engineer) {
            (_, true) => Role::Engineer,
            (true, false) => Role::Operator,
            (false, false) => {
                self.wrong.push((from, now));
                return Err(Refused::Wrong);
            }
        };
        match role {
            Role::Engineer => self.engineer = None,
            _ => self.operator = None,
        }
        self.expire(now);
        while self.sessions.len() >= SESSIONS_MAX {
            let unused = (0..self.sessions.len()).max_by_key(|index| self.sessions[*index].idle(now)).unwrap_or(0);
            self.sessions.remove(unused);
        }
        let mut key = String::with_capacity(32);
        for byte in chance[..8].iter().chain(&chance[24..]) {
            let _ = write!(key, "{byte:02x}");
        }
        let session = Session::kept(self.next, sha256::hex(key.as_bytes()), &name, role, now);
        self.next = self.next.saturating_add(1);
        let who = session.who();
        self.sessions.push(session);
        Ok((key, who))
    }

    /// User of a session key; updates the time of last use.
    pub fn who(&mut self, now: Instant, key: &str) -> Option<Who> {
        self.expire(now);
        let digest = sha256::hex(key.as_bytes());
        let mut found = None;
        for session in &mut self.sessions {
            if is_same(digest.as_bytes(), session.digest.as_bytes()) {
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

    /// Number 1 for each test; its codes are asked for by [`codes`].
    fn fresh() -> Access {
        Access::new(at(0), Vec::new())
    }

    fn codes(access: &mut Access, second: u64, number: u8) -> Codes {
        access.codes(at(second), &chance(number))
    }

    /// Pairs from the address 10.0.0.`from`.
    fn pair(access: &mut Access, second: u64, from: u8, code: &str, number: u8) -> Result<(String, Who), Refused> {
        access.pair(at(second), IpAddr::from([10, 0, 0, from]), code, "x", &chance(number))
    }

    #[test]
    fn roles_match_the_page_in_order_and_names() {
        assert!(Role::Nobody < Role::Viewer && Role::Viewer < Role::Operator && Role::Operator < Role::Engineer);
        assert_eq!(serde_json::to_string(&Role::Engineer).unwrap(), "\"engineer\"");
    }

    #[test]
    fn a_code_pairs_once_and_makes_its_role() {
        let mut access = fresh();
        assert_eq!(pair(&mut access, 0, 1, "00000000", 2).unwrap_err(), Refused::Wrong, "no code was made");
        let Codes { operator, engineer, valid } = codes(&mut access, 0, 1);
        assert_eq!(valid, CODE_TTL);
        assert!(operator != engineer && operator.len() == 8 && engineer.bytes().all(|byte| byte.is_ascii_digit()));
        let spaced = format!(" {} {}\n", &operator[..4], &operator[4..]);
        let (key, who) = pair(&mut access, 1, 1, &spaced, 2).unwrap();
        assert_eq!((who.role, &*who.name, who.device), (Role::Operator, "x", Some(1)));
        assert_eq!(access.who(at(2), &key), Some(who));
        assert_ne!(access.sessions()[0].digest, key, "what is stored lets nobody in");
        assert_eq!(access.who(at(2), &access.sessions()[0].digest.clone()), None);
        assert_eq!(pair(&mut access, 3, 1, &operator, 3).unwrap_err(), Refused::Wrong);
        let next = codes(&mut access, 4, 4);
        assert!(next.engineer == engineer && next.operator != operator, "only the used one is new");
        let (second, who) = pair(&mut access, 5, 1, &engineer, 5).unwrap();
        assert_eq!((who.role, who.device), (Role::Engineer, Some(2)));
        assert!(second != key && second.len() == 32);
    }

    #[test]
    fn an_operators_code_by_itself_is_the_one_that_the_robot_shows() {
        let mut access = fresh();
        let (operator, valid) = access.operator_code(at(0), &chance(1));
        assert_eq!(valid, CODE_TTL);
        assert_eq!(access.operator_code(at(60), &chance(2)), (operator.clone(), Duration::from_secs(540)));
        let shown = codes(&mut access, 120, 3);
        assert!(shown.operator == operator && shown.engineer != operator);
        assert_eq!(pair(&mut access, 130, 1, &operator, 4).unwrap().1.role, Role::Operator);
        assert_ne!(access.operator_code(at(140), &chance(5)).0, operator, "it pairs once");
        assert_eq!(codes(&mut access, 150, 6).engineer, shown.engineer);
    }

    #[test]
    fn a_code_pairs_for_ten_minutes() {
        let mut access = fresh();
        let first = codes(&mut access, 0, 1);
        assert_eq!(codes(&mut access, 300, 2).operator, first.operator);
        assert_eq!(codes(&mut access, 300, 2).valid, Duration::from_secs(300));
        let later = codes(&mut access, 301, 3);
        assert!(later.operator != first.operator && later.valid == CODE_TTL);
        assert_eq!(pair(&mut access, 302, 1, &first.engineer, 4).unwrap_err(), Refused::Wrong, "it was replaced");
        assert_eq!(pair(&mut access, 901, 1, &later.engineer, 5).unwrap_err(), Refused::Wrong, "it has expired");
        let last = codes(&mut access, 901, 6);
        assert!(pair(&mut access, 1500, 1, &last.engineer, 7).is_ok());
    }

    #[test]
    fn wrong_codes_refuse_their_address_and_only_many_addresses_refuse_all() {
        let mut access = fresh();
        let right = codes(&mut access, 0, 1);
        for number in 0..10 {
            let tried = if number % 2 == 0 { "" } else { "123456789" };
            assert_eq!(pair(&mut access, u64::from(number), 1, tried, number).unwrap_err(), Refused::Wrong);
        }
        assert_eq!(pair(&mut access, 59, 1, &right.operator, 2).unwrap_err(), Refused::TooMany, "the right one too");
        assert!(pair(&mut access, 59, 2, &right.operator, 2).is_ok(), "another address is not locked out");
        assert!(pair(&mut access, 60, 1, &right.engineer, 3).is_ok(), "the first is a minute old");
        for number in 0..60 {
            let wrong = pair(&mut access, 200, 10 + number % 20, "", number).unwrap_err();
            assert_eq!(wrong, Refused::Wrong, "{number}");
        }
        let right = codes(&mut access, 200, 4);
        assert_eq!(pair(&mut access, 259, 2, &right.operator, 5).unwrap_err(), Refused::TooMany);
        assert!(pair(&mut access, 260, 2, &right.operator, 5).is_ok());
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
        let code = codes(&mut access, 0, 1).operator;
        let from = IpAddr::from([10, 0, 0, 1]);
        assert_eq!(access.pair(at(0), from, &code, "\u{7}", &chance(2)).unwrap_err(), Refused::Name);
        assert!(pair(&mut access, 0, 1, &code, 2).is_ok(), "the code is not used up");
    }

    #[test]
    fn a_session_that_is_unused_ends_and_one_with_a_socket_does_not() {
        let mut access = fresh();
        let code = codes(&mut access, 0, 1).operator;
        let (key, _) = pair(&mut access, 0, 1, &code, 2).unwrap();
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
            let code = codes(&mut access, number * 100, number as u8 + 2).operator;
            pair(&mut access, number * 100, 1, &code, number as u8 + 2).unwrap();
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
        let good = Session::kept(7, "0123456789abcdef".repeat(4), "phone", Role::Operator, at(0));
        let kept = vec![
            good.clone(),
            Session { role: Role::Viewer, id: 8, ..good.clone() },
            Session { digest: "x".repeat(64), id: 9, ..good.clone() },
            Session { id: 10, ..good.clone() },
            Session { name: " ".into(), id: 11, digest: "f".repeat(64), ..good.clone() },
        ];
        let mut access = Access::new(at(10), kept);
        assert_eq!(access.sessions(), std::slice::from_ref(&good));
        let code = codes(&mut access, 11, 1).operator;
        let (_, who) = pair(&mut access, 11, 1, &code, 2).unwrap();
        assert_eq!(who.device, Some(8), "no number is given twice");
        assert!(Access::new(at(13 * 3600), vec![good]).sessions().is_empty());
    }
}
