//! An SDO client and a server, between which data is damaged, lost, doubled and made up.
//!
//! The client ends each transfer once, in bounded time; what it reads undisturbed is what the server has.
#![no_main]
use base::{Duration, Instant};
use canopen::sdo::{Client, Server};
use canopen::{Payload, drives};

libfuzzer_sys::fuzz_target!(|steps: Vec<(u8, u16, [u8; 8])>| {
    let mut objects = drives::epos::dictionary(1);
    let (mut client, mut server) = (Client::new(Duration::from_millis(500)), Server::new(Duration::from_secs(2)));
    let mut now = Instant::from_millis(1000);
    let (mut open, mut disturbed, mut reads) = (0_u32, true, false);
    let mut answers: Vec<[u8; 8]> = Vec::new();
    for (what, number, data) in steps {
        let (index, sub) = (if data[7] & 1 != 0 { 0x1000 | number & 0x1F } else { number }, data[6] & 7);
        match what % 10 {
            0 => {
                reads = client.read(now, index, sub);
                open += u32::from(reads);
                disturbed &= !reads;
            }
            1 => {
                let payload = Payload::from(&vec![data[0]; usize::from(data[1])][..]);
                let taken = client.write(now, index, sub, payload);
                (open, reads, disturbed) = (open + u32::from(taken), reads && !taken, disturbed || taken);
            }
            2 => {
                disturbed = true;
                client.handle_rx(now, &data[..usize::from(number % 9)]);
            }
            3 => {
                disturbed = true;
                answers.extend(server.handle_rx(now, &data[..usize::from(number % 9)], &mut objects));
            }
            // What is on the way arrives: well, damaged, twice, or not at all.
            4..=6 => {
                while let Some(request) = client.poll_tx() {
                    answers.extend(server.handle_rx(now, &request, &mut objects));
                }
                for mut answer in std::mem::take(&mut answers) {
                    match what % 10 {
                        4 => client.handle_rx(now, &answer),
                        5 => {
                            disturbed = true;
                            answer[usize::from(number % 8)] ^= data[0];
                            client.handle_rx(now, &answer);
                        }
                        _ => {
                            disturbed = true;
                            client.handle_rx(now, &answer);
                            client.handle_rx(now, &answer);
                        }
                    }
                }
            }
            7 => {
                disturbed = true;
                (answers, _) = (Vec::new(), client.poll_tx());
            }
            8 => {
                open -= u32::from(!client.is_idle());
                client.cancel();
                server.reset();
                // What is on the way answers nobody.
                (answers, disturbed) = (Vec::new(), true);
            }
            _ => {
                disturbed = true;
                now += Duration::from_micros(u64::from(number) << (data[0] % 24));
                client.handle_timeout(now);
                answers.extend(server.handle_timeout(now));
                for due in [client.poll_timeout(), server.poll_timeout()].into_iter().flatten() {
                    assert!(due > now, "due at {due:?}, served at {now:?}");
                }
            }
        }
        while let Some(done) = client.poll_done() {
            open -= 1;
            if reads
                && !disturbed
                && let Ok(payload) = &done.result
            {
                let there = objects.read(done.index, done.sub).expect("it was read");
                assert_eq!(&payload[..], &there[..]);
            }
        }
        assert_eq!(open, u32::from(!client.is_idle()), "one end for each transfer");
    }
    for _ in 0..100 {
        let Some(due) = client.poll_timeout() else { break };
        now = now.max(due);
        client.handle_timeout(now);
        while client.poll_tx().is_some() {}
        while client.poll_done().is_some() {}
    }
    assert!(client.is_idle(), "it never ends");
});
