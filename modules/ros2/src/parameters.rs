//! Parameters of the node (`rcl_interfaces`), for reading: settings of the robot. What is asked for is answered as
//! `rclpy` does; a change is refused with the reason.

use crate::cdr::Reader;
use lcm_gen::cdr::Writer;

/// Names at most in a request.
const NAMES_MAX: usize = 256;
/// Why a change is refused.
const READ_ONLY: &str = "read only: the settings of the robot are in robot.toml";

/// Value of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `bool`.
    Bool(bool),
    /// `integer`.
    Integer(i64),
    /// `double`.
    Double(f64),
    /// `string`.
    Text(String),
    /// `double_array`.
    Doubles(Vec<f64>),
    /// `string_array`.
    Texts(Vec<String>),
}

/// A parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, as `limits.speed_mps`.
    pub name: String,
    /// Value.
    pub value: Value,
    /// What it is, for people.
    pub description: String,
}

/// A service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// `list_parameters`.
    List,
    /// `get_parameters`.
    Get,
    /// `get_parameter_types`.
    Types,
    /// `describe_parameters`.
    Describe,
    /// `set_parameters`.
    Set,
    /// `set_parameters_atomically`.
    SetAtomically,
}

impl Service {
    /// All.
    pub const ALL: [Self; 6] = [Self::List, Self::Get, Self::Types, Self::Describe, Self::Set, Self::SetAtomically];

    /// Name below that of the node, and type in ROS.
    #[must_use]
    pub const fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::List => ("list_parameters", "rcl_interfaces/srv/ListParameters"),
            Self::Get => ("get_parameters", "rcl_interfaces/srv/GetParameters"),
            Self::Types => ("get_parameter_types", "rcl_interfaces/srv/GetParameterTypes"),
            Self::Describe => ("describe_parameters", "rcl_interfaces/srv/DescribeParameters"),
            Self::Set => ("set_parameters", "rcl_interfaces/srv/SetParameters"),
            Self::SetAtomically => ("set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically"),
        }
    }

    /// The answer to a request; `None`: it is malformed, or too long.
    #[must_use]
    pub fn answer(self, parameters: &[Parameter], sample: &[u8]) -> Option<Vec<u8>> {
        let mut reader = Reader::new(sample)?;
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        let find = |name: &&str| parameters.iter().find(|parameter| parameter.name == *name);
        match self {
            Self::List => {
                let prefixes = reader.strings(NAMES_MAX)?;
                list(&mut to, parameters, &prefixes, reader.u64()?);
            }
            Self::Get => {
                let names = reader.strings(NAMES_MAX)?;
                to.count(names.len());
                names.iter().for_each(|name| value(&mut to, find(name).map(|parameter| &parameter.value)));
            }
            Self::Types => {
                let names = reader.strings(NAMES_MAX)?;
                to.count(names.len());
                names.iter().for_each(|name| to.u8(find(name).map_or(0, |parameter| parameter.value.kind())));
            }
            Self::Describe => {
                let names = reader.strings(NAMES_MAX)?;
                to.count(names.len());
                names.iter().for_each(|name| describe(&mut to, name, find(name)));
            }
            Self::Set => {
                let count = reader.count(NAMES_MAX)?;
                to.count(count);
                (0..count).for_each(|_| refuse(&mut to));
            }
            Self::SetAtomically => {
                reader.count(NAMES_MAX)?;
                refuse(&mut to);
            }
        }
        Some(cdr)
    }
}

impl Value {
    /// `rcl_interfaces/msg/ParameterType`.
    const fn kind(&self) -> u8 {
        match self {
            Self::Bool(_) => 1,
            Self::Integer(_) => 2,
            Self::Double(_) => 3,
            Self::Text(_) => 4,
            Self::Doubles(_) => 8,
            Self::Texts(_) => 9,
        }
    }
}

/// Names that begin with one of the prefixes, or all, and that have at most `depth` dots behind it, 0: any number; and
/// the prefixes that these have.
fn list(to: &mut Writer<'_>, parameters: &[Parameter], prefixes: &[&str], depth: u64) {
    let is_near = |rest: &str| depth == 0 || (rest.matches('.').count() as u64) < depth;
    let is_below = |name: &str| {
        let rest =
            |prefix: &&str| Some(if name == *prefix { "" } else { name.strip_prefix(prefix)?.strip_prefix('.')? });
        if prefixes.is_empty() { is_near(name) } else { prefixes.iter().filter_map(rest).any(is_near) }
    };
    let names: Vec<&str> = parameters.iter().map(|parameter| &*parameter.name).filter(|name| is_below(name)).collect();
    let mut parents: Vec<&str> = names.iter().filter_map(|name| Some(name.rsplit_once('.')?.0)).collect();
    parents.sort_unstable();
    parents.dedup();
    for list in [names, parents] {
        to.count(list.len());
        list.iter().for_each(|name| to.string(name));
    }
}

/// `rcl_interfaces/msg/ParameterValue`; without a value PARAMETER_NOT_SET.
fn value(to: &mut Writer<'_>, value: Option<&Value>) {
    to.u8(value.map_or(0, Value::kind));
    to.bool(matches!(value, Some(Value::Bool(true))));
    to.i64(if let Some(Value::Integer(number)) = value { *number } else { 0 });
    to.f64(if let Some(Value::Double(number)) = value { *number } else { 0.0 });
    to.string(if let Some(Value::Text(text)) = value { text } else { "" });
    // Arrays of bytes, bools and integers.
    (0..3).for_each(|_| to.count(0));
    let doubles = if let Some(Value::Doubles(numbers)) = value { &numbers[..] } else { &[] };
    to.count(doubles.len());
    doubles.iter().for_each(|number| to.f64(*number));
    let texts = if let Some(Value::Texts(texts)) = value { &texts[..] } else { &[] };
    to.count(texts.len());
    texts.iter().for_each(|text| to.string(text));
}

/// `rcl_interfaces/msg/ParameterDescriptor`.
fn describe(to: &mut Writer<'_>, name: &str, parameter: Option<&Parameter>) {
    to.string(name);
    to.u8(parameter.map_or(0, |parameter| parameter.value.kind()));
    to.string(parameter.map_or("", |parameter| &parameter.description));
    to.string(""); // additional constraints
    to.bool(parameter.is_some()); // read only
    to.bool(false); // dynamic typing
    (0..2).for_each(|_| to.count(0)); // ranges
}

/// `rcl_interfaces/msg/SetParametersResult`.
fn refuse(to: &mut Writer<'_>) {
    to.bool(false);
    to.string(READ_ONLY);
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Random;

    fn parameters() -> Vec<Parameter> {
        let parameter = |name: &str, value| Parameter { name: name.into(), value, description: "what".into() };
        vec![
            parameter("use_sim_time", Value::Bool(false)),
            parameter("limits.speed_mps", Value::Double(0.5)),
            parameter("limits.deep.er", Value::Integer(3)),
            parameter("robot", Value::Text("courier".into())),
            parameter("footprint", Value::Doubles(vec![1.0, 2.0])),
        ]
    }

    fn names(names: &[&str]) -> Vec<u8> {
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        to.count(names.len());
        names.iter().for_each(|name| to.string(name));
        cdr
    }

    fn listed(prefixes: &[&str], depth: u64) -> [Vec<String>; 2] {
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        to.count(prefixes.len());
        prefixes.iter().for_each(|name| to.string(name));
        to.i64(depth.cast_signed());
        let answer = Service::List.answer(&parameters(), &cdr).unwrap();
        let mut reader = Reader::new(&answer).unwrap();
        [(); 2].map(|()| reader.strings(100).unwrap().into_iter().map(String::from).collect())
    }

    #[test]
    fn names_are_listed_by_prefix_and_depth() {
        let [all, parents] = listed(&[], 0);
        assert_eq!((all.len(), parents), (5, vec!["limits".to_owned(), "limits.deep".to_owned()]));
        assert_eq!(listed(&[], 1)[0], ["use_sim_time", "robot", "footprint"]);
        assert_eq!(listed(&["limits"], 1)[0], ["limits.speed_mps"]);
        assert_eq!(listed(&["limits", "robot"], 0)[0], ["limits.speed_mps", "limits.deep.er", "robot"]);
        assert_eq!(listed(&["lim"], 0)[0], [""; 0]);
    }

    #[test]
    fn values_types_and_descriptions_are_read_and_unknown_names_are_not_set() {
        let request = names(&["limits.speed_mps", "nothing"]);
        let types = Service::Types.answer(&parameters(), &request).unwrap();
        assert_eq!(types[4..], [2, 0, 0, 0, 3, 0]);
        let values = Service::Get.answer(&parameters(), &request).unwrap();
        let mut reader = Reader::new(&values).unwrap();
        assert_eq!((reader.u32(), reader.u8(), reader.bool()), (Some(2), Some(3), Some(false)));
        assert_eq!((reader.u64(), reader.f64(), reader.string()), (Some(0), Some(0.5), Some("")));
        let described = Service::Describe.answer(&parameters(), &request).unwrap();
        let mut reader = Reader::new(&described).unwrap();
        assert_eq!((reader.u32(), reader.string(), reader.u8()), (Some(2), Some("limits.speed_mps"), Some(3)));
        assert_eq!((reader.string(), reader.string(), reader.bool()), (Some("what"), Some(""), Some(true)));
    }

    #[test]
    fn a_change_is_refused_with_the_reason() {
        for (service, count) in [(Service::Set, Some(2)), (Service::SetAtomically, None)] {
            let answer = service.answer(&parameters(), &names(&["a", "b"])).unwrap();
            let mut reader = Reader::new(&answer).unwrap();
            if count.is_some() {
                assert_eq!(reader.u32(), count);
            }
            assert_eq!((reader.bool(), reader.string()), (Some(false), Some(READ_ONLY)));
        }
    }

    #[test]
    fn malformed_and_greedy_requests_are_not_answered() {
        let mut greedy = vec![0, 1, 0, 0];
        greedy.extend(u32::MAX.to_le_bytes());
        let mut random = Random::new(4);
        for service in Service::ALL {
            assert_eq!(service.answer(&parameters(), &greedy), None);
            assert_eq!(service.answer(&parameters(), &[0, 1]), None);
            for _ in 0..3000 {
                let length = random.index(60);
                let mut bytes = random.bytes(length);
                bytes.splice(..4.min(length), [0, 1, 0, 0]);
                let answer = service.answer(&parameters(), &bytes);
                assert!(answer.is_none_or(|answer| answer.len() < 64 << 10));
            }
        }
    }
}
