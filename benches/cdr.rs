//! Conversion of messages to CDR, as in logs: `cargo bench -p lcm-gen --bench cdr`.
//!
//! For comparison, the time of the decoder for types known at run time: to validate the bytes, and to convert them to
//! values. Goal: 500 MB/s of sonar readings, so that logging 50 MB/s takes a tenth of a core.
#![allow(clippy::disallowed_methods, reason = "a bench asks the time")]

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use lcm_gen::cdr::Plans;
use lcm_gen::dynamic::{Missing, Types, Value};
use lcm_gen::{Schema, build};

const ROUNDS: usize = 100;

fn main() -> Result<(), Box<dyn Error>> {
    let schema: Schema = build::read(&[concat!(env!("CARGO_MANIFEST_DIR"), "/../../messages")])?;
    let (types, plans) = (Types::new(&schema), Plans::new(&schema));
    let cases = [
        ("lowlevel.data_srfs_t", json(&["timestamp", "srfs"], &[16])),
        ("lowlevel.data_odo_t", json(&["timestamp", "path"], &[])),
        ("lowlevel.data_axes_t", json(&["timestamp", "axes"], &[2])),
        ("common.data_processes_t", json(&["timestamp", "processes"], &[10])),
        ("middlelevel.data_obstacles_t", json(&["timestamp", "x", "y"], &[500, 500])),
        ("lowlevel.data_raw_t", json(&["timestamp", "data"], &[100_000])),
    ];
    println!("{:30} {:>7} {:>7}  ns, best of {ROUNDS} rounds; MB/s of LCM", "", "bytes", "CDR");
    println!("{:46} {:>9} {:>7} {:>9} {:>9}", "", "convert", "MB/s", "check", "values");
    for (name, value) in &cases {
        let ty = types.get(name).ok_or("no such type")?;
        let plan = plans.get(name).ok_or("no plan")?;
        let mut message = Vec::new();
        ty.encode(value, Missing::Zero, &mut message)?;
        let mut cdr = Vec::new();
        plan.convert(&message, &mut cdr)?;
        let calls = (2_000_000 / message.len()).clamp(5, 5000);
        let mut out = Vec::new();
        let mut best = [f64::INFINITY; 3];
        for _ in 0..ROUNDS {
            let convert = round(calls, || {
                out.clear();
                let _ = black_box(plan.convert(black_box(&message), black_box(&mut out)));
            });
            let check = round(calls, || {
                black_box(ty.decode(black_box(&message)).is_ok());
            });
            let values = round(calls, || {
                if let Ok(message) = ty.decode(black_box(&message)) {
                    black_box(&message.value());
                }
            });
            best = [best[0].min(convert), best[1].min(check), best[2].min(values)];
        }
        let speed = message.len() as f64 / best[0] * 1e3;
        let [convert, check, values] = best;
        let (lcm, cdr) = (message.len(), cdr.len());
        println!("{name:30} {lcm:7} {cdr:7} {convert:9.0} {speed:7.0} {check:9.0} {values:9.0}");
    }
    Ok(())
}

/// Message with a timestamp and arrays of these lengths; everything else is zero or empty.
fn json(members: &[&str], counts: &[usize]) -> Value<'static> {
    let mut value = vec![("timestamp".into(), Value::Int(1_321_867_200_123_456))];
    for (member, count) in members[1..].iter().zip(counts) {
        // Elements without values: numbers, or structs without members.
        let element = if ["x", "y", "data"].contains(member) { Value::Int(1) } else { Value::Struct(Vec::new()) };
        value.push(((*member).to_owned().into(), Value::Array(vec![element; *count])));
    }
    Value::Struct(value)
}

/// Nanoseconds per call.
fn round(calls: usize, mut call: impl FnMut()) -> f64 {
    let begin = Instant::now();
    (0..calls).for_each(|_| call());
    begin.elapsed().as_nanos() as f64 / calls as f64
}
