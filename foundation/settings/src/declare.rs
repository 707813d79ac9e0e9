//! The macro [`settings!`](crate::settings!), and the two traits that it implements.

use crate::rows::{Need, Row, Rows};
use crate::{Entry, Node, Origin, Problems, Rule, Table, Value};
use base::Duration;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::marker::PhantomData;
use std::path::PathBuf;

/// Keys of a table that belong together: a whole table, or a part of one that several declarations share.
pub trait Section: Sized {
    /// Takes the keys of this section; what is wrong is noted in the table's problems.
    fn read(table: &mut Table<'_>) -> Self;

    /// Adds a row for each key.
    fn rows(rows: &mut Rows);

    /// Each key with its default; a key without one has the least value that is allowed, or is empty.
    #[must_use]
    fn usual() -> Self {
        let nothing = Node { origin: Origin::CommandLine, value: Value::Table(BTreeMap::new()) };
        let problems = Problems::default();
        let mut table = Table::empty(&nothing.origin, &problems);
        Self::read(&mut table)
    }
}

/// A type that [`settings!`](crate::settings!) declared: a table, or a choice.
pub trait Declared: Sized {
    /// Reads the value of a key.
    fn take(entry: &Entry<'_>) -> Option<Self>;
    /// What is allowed, for errors and for the docs.
    fn expected() -> String;
    /// A value with which reading goes on after an error.
    fn stand_in() -> Self;
    /// The value as it is written in a file; empty for a table.
    fn shown(&self) -> String;
    /// Adds a row for each key below.
    fn rows(rows: &mut Rows);
}

impl<T: Declared> Rule<T> for () {
    fn read(&self, entry: &Entry<'_>) -> Option<T> {
        T::take(entry)
    }

    fn expected(&self) -> String {
        T::expected()
    }

    fn stand_in(&self) -> T {
        T::stand_in()
    }

    fn shown(&self, value: &T) -> String {
        value.shown()
    }

    fn rows(&self, rows: &mut Rows) {
        T::rows(rows);
    }
}

impl<T: Declared> Rule<Vec<T>> for () {
    fn read(&self, entry: &Entry<'_>) -> Option<Vec<T>> {
        let Value::Array(items) = &entry.node.value else {
            entry.refuse(<Self as Rule<Vec<T>>>::expected(self));
            return None;
        };
        let item = |n| entry.item(n).and_then(|item| T::take(&item)).unwrap_or_else(T::stand_in);
        Some((0..items.len()).map(item).collect())
    }

    fn expected(&self) -> String {
        "a list of tables".into()
    }

    fn stand_in(&self) -> Vec<T> {
        Vec::new()
    }

    fn shown(&self, values: &Vec<T>) -> String {
        let mut text = String::from("[");
        for (n, value) in values.iter().enumerate() {
            let comma = if n > 0 { ", " } else { "" };
            // Writing to a string does not fail.
            let _ = write!(text, "{comma}{}", value.shown());
        }
        text + "]"
    }

    fn rows(&self, rows: &mut Rows) {
        rows.below("[]", T::rows);
    }
}

/// Rows of the needs of a key; [`settings!`](crate::settings!) calls these.
impl Rows {
    /// All keys of a section and of the tables in it, each table before its keys.
    #[must_use]
    pub fn of<T: Section>() -> Vec<Row> {
        let mut rows = Self::default();
        T::rows(&mut rows);
        rows.rows
    }

    /// The key must be there.
    pub fn required<T, R: Rule<T>>(&mut self, rule: &R) {
        self.end(rule, Need::Required);
    }

    /// The key may be left out.
    pub fn optional<T, R: Rule<T>>(&mut self, _: PhantomData<Option<T>>, rule: &R) {
        self.end(rule, Need::Optional);
    }

    /// The default of the key follows from others.
    pub fn derived<T, R: Rule<T>>(&mut self, rule: &R) {
        self.end(rule, Need::Derived);
    }

    /// The key has a default.
    pub fn defaulted<T, R: Rule<T>>(&mut self, value: &T, rule: &R) {
        self.end(rule, Need::Default(rule.shown(value)));
    }

    /// The key is a table that may be left out.
    pub fn table<T: Section>(&mut self) {
        self.last("a table", Need::Optional);
        self.within(T::rows);
    }

    /// The key is a table of tables with names of the user's choice.
    pub fn named<T: Section>(&mut self, _: PhantomData<Vec<T>>) {
        self.last("tables with names of your choice", Need::Optional);
        self.within(|rows| rows.below("<name>", T::rows));
    }

    fn end<T>(&mut self, rule: &impl Rule<T>, need: Need) {
        self.last(&rule.expected(), need);
        self.within(|rows| rule.rows(rows));
    }
}

/// How a default is written in a declaration.
pub trait Given<T> {
    /// The value.
    fn given(self) -> T;
}

impl<T> Given<T> for T {
    fn given(self) -> T {
        self
    }
}

/// Seconds.
impl Given<Duration> for f64 {
    fn given(self) -> Duration {
        Duration::from_secs_f64(self)
    }
}

impl Given<String> for &str {
    fn given(self) -> String {
        self.into()
    }
}

impl Given<PathBuf> for &str {
    fn given(self) -> PathBuf {
        self.into()
    }
}

impl<T, const N: usize> Given<Vec<T>> for [T; N] {
    fn given(self) -> Vec<T> {
        self.into()
    }
}

impl<const N: usize> Given<Vec<String>> for [&str; N] {
    fn given(self) -> Vec<String> {
        self.map(String::from).into()
    }
}

/// Declares a part of the configuration once: the type, its strict reader, defaults, ranges, and its rows in the docs.
///
/// A **table** becomes a struct. Each key is a line
///
/// ```text
/// /// What it means, with its unit.
/// KEY [was OLD_KEY] [as FIELD]: TYPE = NEED [, RULE];
/// ```
///
/// | NEED | the key |
/// |---|---|
/// | `required` | must be there |
/// | an expression | may be left out: its default. It may use fields above it after the word `derived` |
/// | `optional` | may be left out: the field is an `Option` |
/// | `table` | is a table that may be left out: then all its keys have their defaults |
/// | `named` | is a table of tables with names of the user's choice (`[can.main]`): the field is a `Vec` |
/// | `key` | is none: the field is the name of this table, where it is one of `named` |
/// | `flat` | is none: the field is another section, whose keys stand in this table |
/// | `unset` and an expression | is none: the field has that value until the wiring of the robot sets it |
///
/// RULE says what is allowed (see [`Rule`]): a range for numbers, nothing for texts, booleans and types that were
/// declared by this macro. A [`Duration`] is written in seconds, its key ends in `_s`. A key that is still read under
/// an older name has that after `was`. `check PATH;` after the table names a function of the section and its [`Table`]
/// that refuses values which do not fit each other.
///
/// A **choice** becomes an enum of the texts that stand for its variants, a **choice `by` a key** an enum whose
/// variants have tables: the key says which, its other keys stand beside it.
///
/// ```
/// use base::Duration;
/// use settings::{Node, Table, read_as, settings};
/// use std::path::Path;
///
/// settings! {
///     /// How lines end.
///     #[derive(Clone, Copy, Debug, PartialEq)]
///     pub enum Ending {
///         /// Terminated by a resistor.
///         Resistor = "resistor",
///         /// Open.
///         Open = "open",
///     }
/// }
///
/// settings! {
///     /// `[line]`: a serial line.
///     #[derive(Clone, Debug, PartialEq)]
///     pub struct Line {
///         /// The device file.
///         port: String = required;
///         /// Transfer rate, Bd.
///         baud: u32 = 115_200, 1200..=4_000_000;
///         /// Longest time to an answer, s.
///         timeout_s was patience as timeout: Duration = 0.02, 0.001..=1.0;
///         /// Frames are logged at most this often, Hz; absent: never.
///         log_rate_hz: Option<f64> = optional, 0.1..=100.0;
///         /// How it ends.
///         ending: Ending = Ending::Open;
///     }
///     check Line::check;
/// }
///
/// impl Line {
///     fn check(&self, table: &Table<'_>) {
///         if self.baud > 1_000_000 && self.ending == Ending::Open {
///             table.refuse("ending", "\"resistor\" above 1 MBd");
///         }
///     }
/// }
///
/// let node = Node::parse(Path::new("line.toml"), "port = \"/dev/ttyS0\"\ntimeout_s = 0.1").unwrap();
/// let line: Line = read_as(&node).unwrap();
/// assert_eq!((line.baud, line.timeout), (115_200, Duration::from_millis(100)));
///
/// let node = Node::parse(Path::new("line.toml"), "baud = 300\nparity = true").unwrap();
/// let errors = read_as::<Line>(&node).unwrap_err();
/// assert_eq!(errors.0[0], "line.toml:1: port: missing, expected a text");
/// assert_eq!(errors.0[1], "line.toml:1: baud = 300: expected an integer from 1200 to 4000000");
/// assert!(errors.0[2].starts_with("line.toml:2: parity: unknown key, expected one of port, baud, "));
/// ```
#[macro_export]
macro_rules! settings {
    // A table: its keys, one after the other, in a common form.
    ($(#[$meta:meta])* $vis:vis struct $name:ident { $($keys:tt)* } $(check $check:path;)?) => {
        $crate::settings! { @keys ([$(#[$meta])*] $vis $name [$($check)?]) [] $($keys)* }
    };
    (@keys $head:tt [$($done:tt)*] $(#[doc = $doc:literal])* $key:ident $(was $old:ident)? as $field:ident : $ty:ty
        = $($rest:tt)+) => {
        $crate::settings! { @need $head [$($done)*] ([$($doc)*] $key [$($old)?] $field $ty) $($rest)+ }
    };
    (@keys $head:tt [$($done:tt)*] $(#[doc = $doc:literal])* $key:ident $(was $old:ident)? : $ty:ty
        = $($rest:tt)+) => {
        $crate::settings! { @need $head [$($done)*] ([$($doc)*] $key [$($old)?] $key $ty) $($rest)+ }
    };
    (@need $head:tt [$($done:tt)*] $key:tt required $(, $rule:expr)?; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key required () ($($rule)?)}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt optional $(, $rule:expr)?; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key optional () ($($rule)?)}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt table; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key table () ()}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt named; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key named () ()}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt key; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key key () ()}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt flat; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key flat () ()}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt unset $default:expr; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key unset ($default) ()}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt derived $default:expr $(, $rule:expr)?; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key derived ($default) ($($rule)?)}] $($rest)* }
    };
    (@need $head:tt [$($done:tt)*] $key:tt $default:expr $(, $rule:expr)?; $($rest:tt)*) => {
        $crate::settings! { @keys $head [$($done)* {$key default ($default) ($($rule)?)}] $($rest)* }
    };
    (@keys ([$(#[$meta:meta])*] $vis:vis $name:ident [$($check:path)?]) [$({
        ([$($doc:literal)*] $key:ident [$($old:ident)?] $field:ident $ty:ty) $need:ident $default:tt $rule:tt
    })*]) => {
        $(#[$meta])*
        $vis struct $name {
            $($(#[doc = $doc])* #[doc = $crate::settings!(@doc $key $need $default $rule)] pub $field: $ty,)*
        }

        impl $crate::Section for $name {
            fn read(table: &mut $crate::Table<'_>) -> Self {
                $(let $field: $ty = $crate::settings!(@read table $key $need $default $rule);)*
                let section = Self { $($field),* };
                $($check(&section, table);)?
                section
            }

            #[allow(unused_variables, reason = "a table may have no keys of its own")]
            fn rows(rows: &mut $crate::Rows) {
                $($crate::settings!(@row rows [$($doc)*] $key [$($old)?] ($ty) $need $default $rule);)*
            }
        }

        impl $crate::Declared for $name {
            fn take(entry: &$crate::Entry<'_>) -> Option<Self> {
                Some(entry.table()?.whole())
            }

            fn expected() -> String {
                "a table".into()
            }

            fn stand_in() -> Self {
                <Self as $crate::Section>::usual()
            }

            fn shown(&self) -> String {
                String::new()
            }

            fn rows(rows: &mut $crate::Rows) {
                <Self as $crate::Section>::rows(rows);
            }
        }
    };
    (@read $table:ident $key:ident required () $rule:tt) => { $table.required(stringify!($key), &$rule) };
    (@read $table:ident $key:ident optional () $rule:tt) => { $table.optional(stringify!($key), &$rule) };
    (@read $table:ident $key:ident table () ()) => { $table.inner(stringify!($key)) };
    (@read $table:ident $key:ident named () ()) => { $table.named(stringify!($key)) };
    (@read $table:ident $key:ident key () ()) => { $table.title() };
    (@read $table:ident $key:ident flat () ()) => { $crate::Section::read($table) };
    (@read $table:ident $key:ident unset ($default:expr) ()) => { $crate::Given::given($default) };
    (@read $table:ident $key:ident $need:ident ($default:expr) $rule:tt) => {
        $table.default(stringify!($key), $crate::Given::given($default), &$rule)
    };
    (@row $rows:ident $doc:tt $key:ident $old:tt ($ty:ty) key () ()) => {};
    (@row $rows:ident $doc:tt $key:ident $old:tt ($ty:ty) unset $default:tt ()) => {};
    (@row $rows:ident $doc:tt $key:ident $old:tt ($ty:ty) flat () ()) => { <$ty as $crate::Section>::rows($rows) };
    (@row $rows:ident [$($doc:literal)*] $key:ident [$($old:ident)?] ($ty:ty) $need:ident $default:tt $rule:tt) => {
        $rows.key(stringify!($key), [$(stringify!($old))?].first().copied(), concat!($($doc),*));
        $crate::settings!(@kind $rows ($ty) $need $default $rule)
    };
    (@kind $rows:ident ($ty:ty) required () $rule:tt) => { $rows.required::<$ty, _>(&$rule) };
    (@kind $rows:ident ($ty:ty) optional () $rule:tt) => {
        $rows.optional(std::marker::PhantomData::<$ty>, &$rule)
    };
    (@kind $rows:ident ($ty:ty) table () ()) => { $rows.table::<$ty>() };
    (@kind $rows:ident ($ty:ty) named () ()) => { $rows.named(std::marker::PhantomData::<$ty>) };
    (@kind $rows:ident ($ty:ty) derived $default:tt $rule:tt) => { $rows.derived::<$ty, _>(&$rule) };
    (@kind $rows:ident ($ty:ty) default ($default:expr) $rule:tt) => {
        $rows.defaulted::<$ty, _>(&$crate::Given::given($default), &$rule)
    };
    (@doc $key:ident unset $default:tt ()) => { "\n\nSet by the wiring." };
    (@doc $key:ident flat () ()) => { "\n\nIts keys are in this table." };
    (@doc $key:ident default ($default:expr) ()) => {
        concat!("\n\nKey `", stringify!($key), "`, default `", stringify!($default), "`.")
    };
    (@doc $key:ident default ($default:expr) ($rule:expr)) => {
        concat!("\n\nKey `", stringify!($key), "`, default `", stringify!($default), "`, `", stringify!($rule), "`.")
    };
    (@doc $key:ident $need:ident $default:tt ()) => { concat!("\n\nKey `", stringify!($key), "`.") };
    (@doc $key:ident $need:ident $default:tt ($rule:expr)) => {
        concat!("\n\nKey `", stringify!($key), "`, `", stringify!($rule), "`.")
    };

    // A choice.
    ($(#[$meta:meta])* $vis:vis enum $name:ident {
        $($(#[$about:meta])* $variant:ident = $text:literal),+ $(,)?
    }) => {
        $(#[$meta])*
        $vis enum $name { $($(#[$about])* $variant),+ }

        impl $name {
            /// Each with its text, in the order of the declaration.
            pub const ALL: &'static [(&'static str, Self)] = &[$(($text, Self::$variant)),+];

            /// Its text in files.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self { $(Self::$variant => $text),+ }
            }
        }

        impl $crate::Declared for $name {
            fn take(entry: &$crate::Entry<'_>) -> Option<Self> {
                $crate::Rule::read(&$crate::Choice(Self::ALL), entry)
            }

            fn expected() -> String {
                $crate::Rule::expected(&$crate::Choice(Self::ALL))
            }

            fn stand_in() -> Self {
                $crate::Rule::stand_in(&$crate::Choice(Self::ALL))
            }

            fn shown(&self) -> String {
                format!("{:?}", self.name())
            }

            fn rows(_: &mut $crate::Rows) {}
        }
    };

    // A choice by a key of the same table.
    ($(#[$meta:meta])* $vis:vis enum $name:ident by $key:ident {
        $($(#[doc = $doc:literal])* $variant:ident($ty:ty) = $text:literal),+ $(,)?
    }) => {
        $(#[$meta])*
        $vis enum $name { $($(#[doc = $doc])* $variant($ty)),+ }

        impl $name {
            /// The text of its key.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self { $(Self::$variant(_) => $text),+ }
            }
        }

        impl $crate::Section for $name {
            fn read(table: &mut $crate::Table<'_>) -> Self {
                let choice: &str = table.required(stringify!($key), &$crate::Choice(&[$(($text, $text)),+]));
                match choice {
                    $($text => Self::$variant($crate::Section::read(table)),)+
                    _ => unreachable!("a choice is one of its texts"),
                }
            }

            fn rows(rows: &mut $crate::Rows) {
                let about = concat!($("`", $text, "`:", $($doc,)* " ",)+);
                rows.key(stringify!($key), None, about);
                rows.required::<&str, _>(&$crate::Choice(&[$(($text, $text)),+]));
                $(rows.only($text, <$ty as $crate::Section>::rows);)+
            }
        }
    };
}
