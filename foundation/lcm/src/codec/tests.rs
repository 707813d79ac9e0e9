//! The codec by itself: limits, and what each kind of wrong bytes is told.

use super::*;

/// What lcm-gen would write for `struct t { string name; int8_t n; double x[n][2]; }`.
#[derive(Debug, Default, PartialEq)]
struct Sample {
    name: String,
    x: Vec<[f64; 2]>,
}

impl Type for Sample {
    const FINGERPRINT: u64 = 0x0123_4567_89ab_cdef;
    const NAME: &'static str = "t";
    const MIN_SIZE: usize = 6;

    fn body_size(&self) -> usize {
        6 + self.name.len() + 16 * self.x.len()
    }

    fn encode_body(&self, w: &mut Writer<'_>) -> Result<(), EncodeError> {
        w.string("name", &self.name)?;
        w.count::<i8>("n", self.x.len())?;
        w.put_all(&self.x);
        Ok(())
    }

    fn decode_body(r: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let name = r.string()?;
        let n = r.count::<i8>()?;
        Ok(Self { name, x: r.get_vec(n)? })
    }
}

fn sample() -> Sample {
    Sample { name: "žluťoučký".into(), x: vec![[1.5, -0.0], [f64::MIN_POSITIVE, f64::INFINITY]] }
}

#[test]
fn a_message_is_its_fingerprint_and_its_members_big_endian() {
    let mut out = vec![7];
    Sample { name: "a".into(), x: vec![[1.0, -2.0]] }.encode(&mut out).unwrap();
    let body = [0, 0, 0, 2, b'a', 0, 1, 0x3F, 0xF0, 0, 0, 0, 0, 0, 0, 0xC0, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(out, [&[7, 0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF], &body[..]].concat());
    assert_eq!(fingerprint(&out[1..]), Some(Sample::FINGERPRINT));
    assert_eq!(fingerprint(&out[..7]), None);
}

#[test]
fn decoding_undoes_encoding_and_refuses_every_part() {
    let mut out = Vec::new();
    sample().encode(&mut out).unwrap();
    assert_eq!(Sample::decode(&out), Ok(sample()));
    for end in 0..out.len() {
        assert!(Sample::decode(&out[..end]).is_err(), "cut after {end} bytes");
    }
    out.push(0);
    assert_eq!(Sample::decode(&out), Err(DecodeError::LeftOver { extra: 1 }));
}

#[test]
fn what_cannot_be_written_leaves_the_buffer_as_it_was() {
    let mut out = vec![1, 2];
    let long = Sample { x: vec![[0.0; 2]; 128], ..Sample::default() };
    assert_eq!(long.encode(&mut out), Err(EncodeError::TooLong { member: "n", len: 128, max: 127 }));
    for at in 0..20 {
        let mut name = "x".repeat(19);
        name.insert(at, '\0');
        let nul = Sample { name, ..Sample::default() };
        assert_eq!(nul.encode(&mut out), Err(EncodeError::Nul { member: "name" }));
    }
    assert_eq!(out, [1, 2]);
}

#[test]
fn a_buffer_with_a_past_gives_the_same_bytes() {
    let (mut fresh, mut used) = (Vec::new(), vec![0xFF; 500]);
    used.clear();
    sample().encode(&mut fresh).unwrap();
    sample().encode(&mut used).unwrap();
    assert_eq!(fresh, used);
}

#[test]
fn a_nul_is_found_wherever_it_is_and_nothing_is_taken_for_one() {
    for len in 0..40 {
        let bytes = vec![1; len];
        assert!(!has_nul(&bytes) && !has_nul(&vec![0x80; len]) && !has_nul(&vec![0xFF; len]));
        for at in 0..len {
            let mut with = bytes.clone();
            with[at] = 0;
            assert!(has_nul(&with), "at {at} of {len}");
        }
    }
}

#[test]
fn any_byte_but_zero_is_true() {
    assert_eq!([0, 1, 2, 0xFF].map(|byte| bool::load(&[byte])), [false, true, true, true]);
}

#[test]
fn elements_without_bytes_are_bounded_in_all() {
    let mut r = Reader::new(&[]);
    let nothing = |_: &mut Reader<'_>| Ok(());
    assert_eq!(r.vec(MAX_EMPTY - 1, 0, nothing).map(|v| v.len()), Ok(MAX_EMPTY - 1));
    assert_eq!(r.vec(2, 0, nothing), Err(DecodeError::Count { count: 2, max: 1 }));
    assert_eq!(r.get_vec::<[u8; 0]>(1).map(|v| v.len()), Ok(1));
    assert_eq!(r.get_vec::<[u8; 0]>(1), Err(DecodeError::Count { count: 1, max: 0 }));
}

#[test]
fn arrays_of_what_varies_come_whole_or_not_at_all() {
    let bytes = [0, 0, 0, 1, 0, 0, 0, 0, 2, b'a', 0];
    let mut r = Reader::new(&bytes);
    assert_eq!(r.array(Reader::string), Ok([String::new(), "a".to_owned()]));
    let mut r = Reader::new(&bytes[..10]);
    let error = DecodeError::StringLength { len: 2, left: 1 };
    assert_eq!(r.array::<_, 2>(Reader::string), Err(error));
}
