//! CDR reader that uses only the `ros2msg` text.

use std::collections::BTreeMap;

use lcm_gen::dynamic::Value;

/// Fields of each message of a text by `package/Name`, the message itself under the empty name.
pub struct Text<'a>(BTreeMap<&'a str, Vec<Field<'a>>>);

struct Field<'a> {
    ty: &'a str,
    /// `None`: no array. `Some(None)`: a sequence.
    count: Option<Option<usize>>,
    name: &'a str,
}

impl<'a> Text<'a> {
    pub fn new(text: &'a str) -> Self {
        let (mut messages, mut name) = (BTreeMap::new(), "");
        messages.insert("", Vec::new());
        let rule = "=".repeat(80);
        for line in text.lines().filter(|line| *line != rule) {
            if let Some(next) = line.strip_prefix("MSG: ") {
                name = next;
                assert!(messages.insert(name, Vec::new()).is_none(), "{name} twice");
                continue;
            }
            let (ty, rest) = line.split_once(' ').unwrap_or_else(|| panic!("{line:?}"));
            if let Some((constant, value)) = rest.split_once('=') {
                assert!(value.parse::<f64>().is_ok() && is_name(&constant.to_lowercase()), "{line}");
                continue;
            }
            let (rest, default) = rest.split_once(' ').unwrap_or((rest, "0"));
            assert!(is_name(rest) && default.parse::<f64>().is_ok(), "{line}");
            let (ty, count) = match ty.strip_suffix(']').and_then(|ty| ty.split_once('[')) {
                Some((ty, count)) => (ty, Some((!count.is_empty()).then(|| count.parse().unwrap()))),
                None => (ty, None),
            };
            messages.get_mut(name).unwrap().push(Field { ty, count, name: rest });
        }
        Self(messages)
    }

    /// Decodes the whole message; panics if the bytes do not match.
    pub fn read(&self, cdr: &[u8]) -> Value<'static> {
        let mut reader = Reader { bytes: cdr.strip_prefix(&[0, 1, 0, 0]).unwrap(), at: 0 };
        let value = self.body("", &mut reader);
        assert_eq!(reader.at, reader.bytes.len(), "bytes are left over");
        value
    }

    fn body(&self, name: &str, reader: &mut Reader) -> Value<'static> {
        let fields = self.0.get(name).unwrap_or_else(|| panic!("{name} is nowhere"));
        assert!(!fields.is_empty(), "{name} has no field");
        let mut members = Vec::new();
        for field in fields {
            let count = field.count.map(|count| count.unwrap_or_else(|| u32::from_le_bytes(reader.take()) as usize));
            let value = match count {
                Some(count) => Value::Array((0..count).map(|_| self.one(field.ty, reader)).collect()),
                None => self.one(field.ty, reader),
            };
            members.push((field.name.to_owned().into(), value));
        }
        Value::Struct(members)
    }

    fn one(&self, ty: &str, reader: &mut Reader) -> Value<'static> {
        match ty {
            "bool" => {
                let [byte] = reader.take();
                assert!(byte < 2);
                Value::Bool(byte == 1)
            }
            "uint8" | "byte" => Value::Int(u8::from_le_bytes(reader.take()).into()),
            "int8" => Value::Int(i8::from_le_bytes(reader.take()).into()),
            "int16" => Value::Int(i16::from_le_bytes(reader.take()).into()),
            "uint32" => Value::Int(u32::from_le_bytes(reader.take()).into()),
            "int32" => Value::Int(i32::from_le_bytes(reader.take()).into()),
            "int64" => Value::Int(i64::from_le_bytes(reader.take())),
            "float32" => Value::Single(f32::from_le_bytes(reader.take())),
            "float64" => Value::Float(f64::from_le_bytes(reader.take())),
            "string" => {
                let size = u32::from_le_bytes(reader.take());
                let text: Vec<u8> = (1..size).map(|_| u8::from_le_bytes(reader.take())).collect();
                assert_eq!(reader.take(), [0]);
                Value::Text(String::from_utf8(text).unwrap().into())
            }
            name => self.body(name, reader),
        }
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let gap = self.at..self.at.next_multiple_of(N);
        assert!(self.bytes[gap.clone()].iter().all(|byte| *byte == 0));
        self.at = gap.end + N;
        self.bytes[gap.end..self.at].try_into().unwrap()
    }
}

/// True if ROS 2 accepts the field name.
fn is_name(name: &str) -> bool {
    let known = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_';
    name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.chars().all(known)
        && !name.contains("__")
        && !name.ends_with('_')
}
