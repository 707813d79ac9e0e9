//! The table state x input -> next state, and what comes out on the way.

use super::*;

const NOW: Instant = Instant::from_millis(1000);
const LATER: Instant = Instant::from_millis(2000);

/// A fresh master brought into a state: `tries` attempts left.
fn enter(state: &str) -> Master {
    let mut master = Master::new(Config { retries: if state.ends_with("last)") { 0 } else { 2 }, ..config() });
    master.add_node(0x20, Duration::from_millis(20));
    let request = Request { answer: Lengths::exactly(4), ..Request::new(0x20, 0x01, &[]) };
    let name = state.split(' ').next().unwrap();
    if name == "Idle" {
        return master;
    }
    if name == "Gap" {
        master.handle_rx(NOW, &words("00"));
    }
    let request = Request { no_ack: state.ends_with("no answer)"), ..request };
    master.request(request).unwrap();
    if name == "Gap" {
        return master;
    }
    master.handle_timeout(NOW);
    if name == "Ready" {
        return master;
    }
    assert!(master.poll_tx(NOW).is_some());
    if name == "Sending" {
        return master;
    }
    master.handle_tx_done(NOW);
    master
}

fn apply(master: &mut Master, input: &str) {
    match input {
        "request" => drop(master.request(Request::new(0x20, 0x01, &[]))),
        "poll_tx" => drop(master.poll_tx(LATER).is_some()),
        "tx_done" => master.handle_tx_done(NOW),
        "rx part" => master.handle_rx(NOW, &words("20! 01")),
        "rx answer" => master.handle_rx(NOW, &words("20! 01 00 04 01 00 ff ff 36")),
        "rx damaged" => master.handle_rx(NOW, &words("20! 01 00 04 01 00 fe ff 36")),
        "rx BADCRC" => master.handle_rx(NOW, &words("20! 01 02 00 04")),
        "rx other" => master.handle_rx(NOW, &words("20! 02 00 00 10")),
        "timeout" => master.handle_timeout(LATER),
        "cancel" => master.cancel(),
        other => panic!("{other}"),
    }
}

fn name(state: &State) -> String {
    match state {
        State::Idle => "Idle".into(),
        State::Gap { attempt, .. } if attempt.first => "Gap".into(),
        State::Gap { .. } => "Gap again".into(),
        State::Ready { .. } => "Ready".into(),
        State::Sending { .. } => "Sending".into(),
        State::Waiting { .. } => "Waiting".into(),
    }
}

#[test]
fn the_state_table_is_the_one_that_was_checked() {
    let states = ["Idle", "Gap", "Ready", "Sending", "Sending (no answer)", "Waiting", "Waiting (last)"];
    let inputs = [
        "request",
        "poll_tx",
        "tx_done",
        "rx part",
        "rx answer",
        "rx damaged",
        "rx BADCRC",
        "rx other",
        "timeout",
        "cancel",
    ];
    let mut table = String::new();
    for state in states {
        for input in inputs {
            let mut master = enter(state);
            apply(&mut master, input);
            let mut line = format!("{state:19} | {input:10} | {}", name(&master.state));
            while let Some(event) = master.poll_event() {
                line += &format!(", {}", write_event(&event));
            }
            table += &line;
            table.push('\n');
        }
    }
    assert_eq!(table, include_str!("table.txt"), "\n{table}");
}
