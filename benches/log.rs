//! Process of the logger under load: `cargo bench -p advee --bench log`.
//!
//! Another process publishes 50 MB/s of mixed messages for 20 s: how many of them are in the files, and the processor
//! time and memory of the logger meanwhile. Then the traffic of a robot, 60 kB/s. Goals: no loss; 5 % of a core at the
//! robot's traffic.

#[path = "../advee/tests/support/log.rs"]
mod log;
#[path = "../advee/tests/support.rs"]
mod support;

use log::Rig;
use mcap::read::{MessageStream, Options};
use messages::{Message, lowlevel, middlelevel};
use std::fs;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Messages of one turn: channel, and bytes in addition to the number with which each begins.
const LARGE: [(&str, usize); 4] = [("SCAN", 1_000), ("CLOUD", 16_000), ("PICTURE", 60_000), ("MAP", 1_000_000)];

fn main() {
    let args: Vec<String> = std::env::args().collect();
    if let [_, word, url, rate, seconds] = &args[..]
        && word == "traffic"
    {
        let number = |text: &str| text.parse::<f64>().expect("a number");
        return traffic(url, number(rate), number(seconds));
    }
    measure("50 MB/s", 50e6, 20.0);
    measure("60 kB/s, as a robot", 60e3, 20.0);
}

/// Publishes `rate` bytes per second, and prints the number of messages.
fn traffic(url: &str, rate: f64, seconds: f64) {
    let mut bus = support::listen(url);
    let odo = encoded(lowlevel::DataOdo::default());
    let ranges = encoded(lowlevel::DataSrfs { srfs: vec![lowlevel::Range::default(); 16], ..Default::default() });
    let estimate = encoded(middlelevel::DataEstimate::default());
    // Half of each byte is random: pictures and scans do not compress to nothing.
    let mut random = 0x9E37_79B9u32;
    let mut next = || {
        random ^= random << 13;
        random ^= random >> 17;
        random ^= random << 5;
        (random >> 24) as u8 & 0x0F
    };
    let noise: Vec<u8> = (0..1_001_000).map(|_| next()).collect();
    let large = if rate > 1e6 { &LARGE[..] } else { &[] };
    let begin = Instant::now();
    let (mut bytes, mut count, mut turn) = (0usize, 0u64, 0u64);
    while begin.elapsed().as_secs_f64() < seconds {
        let mut say = |channel: &str, data: &[u8]| {
            log::publish(&mut bus, channel, data);
            bytes += data.len();
            count += 1;
        };
        for _ in 0..8 {
            say("LL_DATA_ODO", &odo);
            say("ML_DATA_ESTIMATE", &estimate);
        }
        say("LL_DATA_SRFS", &ranges);
        for (n, (channel, size)) in large.iter().enumerate() {
            // Each half as frequent as the previous one, the last a tenth of that.
            if turn % if n == 3 { 32 } else { 1 << n } == 0 {
                say(channel, &[&turn.to_le_bytes()[..], &noise[turn as usize % 1000..][..*size]].concat());
            }
        }
        turn += 1;
        let due = Duration::from_secs_f64(bytes as f64 / rate);
        thread::sleep(due.saturating_sub(begin.elapsed()));
        // Messages of others are discarded.
        while let Ok(Some(_)) = bus.recv() {}
    }
    println!("{count} {bytes} {}", begin.elapsed().as_secs_f64());
}

fn encoded(message: impl Into<Message>) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.into().encode(&mut bytes).expect("encodable");
    bytes
}

fn measure(what: &str, rate: f64, seconds: f64) {
    let mut rig = Rig::new();
    let logger = rig.start(&[]);
    let own = std::env::current_exe().expect("this executable");
    let arguments = ["traffic", &rig.url, &rate.to_string(), &seconds.to_string()];
    let mut said = Command::new(own).args(arguments).stdout(Stdio::piped()).spawn().expect("it runs");
    let (before, mut pss) = (logger.cpu(), 0);
    while said.try_wait().expect("it is our child").is_none() {
        thread::sleep(Duration::from_millis(100));
        pss = pss.max(logger.pss());
        // Keeps the receive buffer of this process empty.
        rig.listen();
    }
    let used = logger.cpu() - before;
    let output = said.wait_with_output().expect("its output").stdout;
    let output = String::from_utf8_lossy(&output);
    let numbers: Vec<f64> = output.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let [count, bytes, took] = numbers[..] else { panic!("traffic said {output:?}") };
    thread::sleep(Duration::from_secs(1));
    rig.listen();
    let dropped = rig.last.as_ref().map_or(0, |log| log.dropped);
    assert_eq!(logger.stop(), 0);
    let ours = |topic: &str| {
        LARGE.iter().any(|(name, _)| topic == *name) || topic.starts_with("LL_DATA") || topic.starts_with("ML_DATA")
    };
    let (mut recorded, mut size) = (0u64, 0u64);
    for file in rig.files() {
        let bytes = fs::read(file).expect("a file");
        size += bytes.len() as u64;
        let stream =
            MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into()).expect("no file is refused");
        let raw = stream.map_while(Result::ok).filter(|message| message.channel.message_encoding == "lcm");
        recorded += raw.filter(|message| ours(&message.channel.topic)).count() as u64;
    }
    println!("{what}: {:.2} MB/s, {:.0} messages/s for {took:.1} s", bytes / took / 1e6, count / took);
    println!(
        "  recorded {recorded} of {count}, {} lost; the logger says it dropped {dropped}",
        count as i64 - recorded as i64
    );
    println!(
        "  {:.1} % of a core, {:.1} MB PSS at most; {:.1} MB on disk",
        used / took * 100.0,
        pss as f64 / 1e6,
        size as f64 / 1e6
    );
}
