//! Rules for the values of keys.

use crate::reader::Entry;
use crate::rows::Rows;
use crate::tree::Value;
use base::Duration;
use std::fmt::{Debug, Display};
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Rule for the value of a key.
///
/// | rule | for |
/// |---|---|
/// | a range | `f64`, integers, [`Duration`] in seconds, lists of `u16` and `u32` |
/// | `()`, the default | `bool`, [`String`] and [`PathBuf`] (not empty), lists of texts, declared tables, their lists |
/// | [`Corners`](crate::Corners) | polygons, lists of polygons |
/// | [`ZeroOr`], [`Off`], [`Blank`], [`Texts`], [`Span`], [`Form`], [`Bytes`], [`Choice`], [`Parsed`] | see there |
pub trait Rule<T> {
    /// Converts a value; `None` if it is not allowed.
    fn accept(&self, value: &Value) -> Option<T> {
        let _ = value;
        None
    }

    /// Reads the value of a key; rejects a value that is not allowed.
    fn read(&self, entry: &Entry<'_>) -> Option<T> {
        let value = self.accept(&entry.node.value);
        if value.is_none() {
            entry.refuse(self.expected());
        }
        value
    }

    /// Allowed values, for errors and for the docs: `a number from 0 to 1`.
    fn expected(&self) -> String;

    /// Allowed value with which reading continues after an error.
    fn stand_in(&self) -> T;

    /// Value as written in a file.
    fn shown(&self, value: &T) -> String;

    /// Adds the rows of the keys below, if the value is a table.
    fn rows(&self, rows: &mut Rows) {
        let _ = rows;
    }
}

/// A number with six digits: enough for a default in the docs.
fn short(value: f64) -> String {
    format!("{value:.5e}").parse().unwrap_or(value).to_string()
}

fn texts(values: &[impl Debug]) -> String {
    format!("{values:?}")
}

impl Rule<f64> for RangeInclusive<f64> {
    fn accept(&self, value: &Value) -> Option<f64> {
        value.number().filter(|value| self.contains(value))
    }

    fn expected(&self) -> String {
        format!("a number from {} to {}", self.start(), self.end())
    }

    fn stand_in(&self) -> f64 {
        *self.start()
    }

    fn shown(&self, value: &f64) -> String {
        short(*value)
    }
}

/// Seconds.
impl Rule<Duration> for RangeInclusive<f64> {
    fn accept(&self, value: &Value) -> Option<Duration> {
        Rule::<f64>::accept(self, value).map(Duration::from_secs_f64)
    }

    fn expected(&self) -> String {
        Rule::<f64>::expected(self)
    }

    fn stand_in(&self) -> Duration {
        Duration::from_secs_f64(*self.start())
    }

    fn shown(&self, value: &Duration) -> String {
        short(value.as_secs_f64())
    }
}

macro_rules! integers {
    ($($integer:ty),*) => {
        $(impl Rule<$integer> for RangeInclusive<$integer> {
            fn accept(&self, value: &Value) -> Option<$integer> {
                let Value::Integer(value) = value else { return None };
                <$integer>::try_from(*value).ok().filter(|value| self.contains(value))
            }

            fn expected(&self) -> String {
                format!("an integer from {} to {}", self.start(), self.end())
            }

            fn stand_in(&self) -> $integer {
                *self.start()
            }

            fn shown(&self, value: &$integer) -> String {
                value.to_string()
            }
        })*
    };
}

integers!(i8, u8, u16, u32, u64);

macro_rules! lists {
    ($($integer:ty),*) => {
        $(impl Rule<Vec<$integer>> for RangeInclusive<$integer> {
            fn accept(&self, value: &Value) -> Option<Vec<$integer>> {
                let Value::Array(items) = value else { return None };
                items.iter().map(|item| Rule::<$integer>::accept(self, &item.value)).collect()
            }

            fn expected(&self) -> String {
                format!("a list of integers from {} to {}", self.start(), self.end())
            }

            fn stand_in(&self) -> Vec<$integer> {
                Vec::new()
            }

            fn shown(&self, values: &Vec<$integer>) -> String {
                texts(values)
            }
        })*
    };
}

lists!(u16, u32);

impl Rule<bool> for () {
    fn accept(&self, value: &Value) -> Option<bool> {
        if let Value::Bool(value) = value { Some(*value) } else { None }
    }

    fn expected(&self) -> String {
        "true or false".into()
    }

    fn stand_in(&self) -> bool {
        false
    }

    fn shown(&self, value: &bool) -> String {
        value.to_string()
    }
}

impl Rule<String> for () {
    fn accept(&self, value: &Value) -> Option<String> {
        if let Value::String(text) = value { Some(text.clone()).filter(|text| !text.is_empty()) } else { None }
    }

    fn expected(&self) -> String {
        "a text".into()
    }

    fn stand_in(&self) -> String {
        String::new()
    }

    fn shown(&self, value: &String) -> String {
        format!("{value:?}")
    }
}

impl Rule<PathBuf> for () {
    fn accept(&self, value: &Value) -> Option<PathBuf> {
        Rule::<String>::accept(self, value).map(PathBuf::from)
    }

    fn expected(&self) -> String {
        Rule::<String>::expected(self)
    }

    fn stand_in(&self) -> PathBuf {
        PathBuf::new()
    }

    fn shown(&self, value: &PathBuf) -> String {
        format!("{value:?}")
    }
}

impl Rule<Vec<String>> for () {
    fn accept(&self, value: &Value) -> Option<Vec<String>> {
        let Value::Array(items) = value else { return None };
        items.iter().map(|item| Rule::<String>::accept(self, &item.value)).collect()
    }

    fn expected(&self) -> String {
        "a list of texts".into()
    }

    fn stand_in(&self) -> Vec<String> {
        Vec::new()
    }

    fn shown(&self, values: &Vec<String>) -> String {
        texts(values)
    }
}

/// 0, or a number in a range.
pub struct ZeroOr(pub RangeInclusive<f64>);

impl<T> Rule<T> for ZeroOr
where
    RangeInclusive<f64>: Rule<T>,
{
    fn accept(&self, value: &Value) -> Option<T> {
        let anything = f64::NEG_INFINITY..=f64::INFINITY;
        self.0.accept(value).or_else(|| (value.number() == Some(0.0)).then(|| anything.accept(value))?)
    }

    fn expected(&self) -> String {
        format!("0, or {}", Rule::<f64>::expected(&self.0))
    }

    fn stand_in(&self) -> T {
        self.0.stand_in()
    }

    fn shown(&self, value: &T) -> String {
        self.0.shown(value)
    }
}

/// Value of the inner rule; zero means `None`.
pub struct Off<R>(pub R);

impl<T: Default + PartialEq, R: Rule<T>> Rule<Option<T>> for Off<R> {
    fn accept(&self, value: &Value) -> Option<Option<T>> {
        self.0.accept(value).map(|value| Some(value).filter(|value| *value != T::default()))
    }

    fn expected(&self) -> String {
        self.0.expected()
    }

    fn stand_in(&self) -> Option<T> {
        None
    }

    fn shown(&self, value: &Option<T>) -> String {
        self.0.shown(value.as_ref().unwrap_or(&T::default()))
    }
}

/// A list of texts that is not empty, and the text that describes it.
pub struct Texts(pub &'static str);

impl Rule<Vec<String>> for Texts {
    fn accept(&self, value: &Value) -> Option<Vec<String>> {
        ().accept(value).filter(|texts: &Vec<String>| !texts.is_empty())
    }

    fn expected(&self) -> String {
        self.0.into()
    }

    fn stand_in(&self) -> Vec<String> {
        Vec::new()
    }

    fn shown(&self, values: &Vec<String>) -> String {
        texts(values)
    }
}

/// One number, or the least and the greatest.
pub struct Span(pub RangeInclusive<f64>);

impl Rule<(f64, f64)> for Span {
    fn accept(&self, value: &Value) -> Option<(f64, f64)> {
        let number = |value: &Value| Rule::<f64>::accept(&self.0, value);
        let Value::Array(items) = value else { return number(value).map(|both| (both, both)) };
        let [least, greatest] = &items[..] else { return None };
        let span = (number(&least.value)?, number(&greatest.value)?);
        (span.0 <= span.1).then_some(span)
    }

    fn expected(&self) -> String {
        format!("{}, or a list of two, the lesser first", Rule::<f64>::expected(&self.0))
    }

    fn stand_in(&self) -> (f64, f64) {
        (*self.0.start(), *self.0.start())
    }

    fn shown(&self, (least, greatest): &(f64, f64)) -> String {
        if least == greatest { least.to_string() } else { format!("[{least}, {greatest}]") }
    }
}

/// A text; an empty one counts as absent.
pub struct Blank;

impl<T> Rule<Option<T>> for Blank
where
    (): Rule<T>,
{
    fn accept(&self, value: &Value) -> Option<Option<T>> {
        let empty = matches!(value, Value::String(text) if text.is_empty());
        if empty { Some(None) } else { ().accept(value).map(Some) }
    }

    fn expected(&self) -> String {
        Rule::<T>::expected(&())
    }

    fn stand_in(&self) -> Option<T> {
        None
    }

    fn shown(&self, value: &Option<T>) -> String {
        value.as_ref().map_or_else(|| "\"\"".into(), |value| ().shown(value))
    }
}

/// A number of bytes, which may be written as `256e6`.
pub struct Bytes(pub RangeInclusive<f64>);

macro_rules! bytes {
    ($($integer:ty),*) => {
        $(impl Rule<$integer> for Bytes {
            fn accept(&self, value: &Value) -> Option<$integer> {
                Rule::<f64>::accept(&self.0, value).map(|bytes| bytes as $integer)
            }

            fn expected(&self) -> String {
                Rule::<f64>::expected(&self.0)
            }

            fn stand_in(&self) -> $integer {
                *self.0.start() as $integer
            }

            fn shown(&self, value: &$integer) -> String {
                value.to_string()
            }
        })*
    };
}

bytes!(u64, usize);

/// One of several texts, each with its value.
pub struct Choice<T: 'static>(pub &'static [(&'static str, T)]);

impl<T: Clone + PartialEq> Rule<T> for Choice<T> {
    fn accept(&self, value: &Value) -> Option<T> {
        let Value::String(text) = value else { return None };
        self.0.iter().find(|(name, _)| name == text).map(|(_, choice)| choice.clone())
    }

    fn expected(&self) -> String {
        self.0.iter().map(|(name, _)| format!("{name:?}")).collect::<Vec<_>>().join(" or ")
    }

    fn stand_in(&self) -> T {
        self.0[0].1.clone()
    }

    fn shown(&self, value: &T) -> String {
        let found = self.0.iter().find(|(_, choice)| choice == value);
        found.map_or_else(String::new, |(name, _)| format!("{name:?}"))
    }
}

/// A value of a form of its own: how it is read, and refused; what is allowed; how the default is written; its rows.
pub struct Form<T>(pub fn(&Entry<'_>) -> Option<T>, pub &'static str, pub &'static str, pub fn(&mut Rows));

impl<T: Default> Rule<T> for Form<T> {
    fn read(&self, entry: &Entry<'_>) -> Option<T> {
        (self.0)(entry)
    }

    fn expected(&self) -> String {
        self.1.into()
    }

    fn stand_in(&self) -> T {
        T::default()
    }

    fn shown(&self, _: &T) -> String {
        self.2.into()
    }

    fn rows(&self, rows: &mut Rows) {
        (self.3)(rows);
    }
}

/// A text that stands for a value: how it is read, what is allowed, and how a value that is allowed is written.
pub struct Parsed<T>(pub fn(&str) -> Option<T>, pub &'static str, pub &'static str);

impl<T: Display> Rule<T> for Parsed<T> {
    fn accept(&self, value: &Value) -> Option<T> {
        if let Value::String(text) = value { (self.0)(text) } else { None }
    }

    fn expected(&self) -> String {
        self.1.into()
    }

    fn stand_in(&self) -> T {
        (self.0)(self.2).expect("the example in a declaration is allowed")
    }

    fn shown(&self, value: &T) -> String {
        format!("{:?}", value.to_string())
    }
}
