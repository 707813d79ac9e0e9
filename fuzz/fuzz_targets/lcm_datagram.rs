//! Datagrams from anybody, through the receiver that every process has: each is counted once.
#![no_main]
use lcm::receiver::Receiver;
use std::net::{Ipv4Addr, SocketAddrV4};

libfuzzer_sys::fuzz_target!(|datagrams: Vec<(u16, &[u8])>| {
    let mut receiver = Receiver::default();
    receiver.subscribe("LL_.*").expect("a good pattern");
    let mut taken = 0;
    let all = datagrams.len() as u64;
    for (port, datagram) in datagrams {
        taken += u64::from(receiver.handle_rx(SocketAddrV4::new(Ipv4Addr::LOCALHOST, port), datagram).is_some());
    }
    let stats = receiver.stats;
    assert_eq!(stats.received, taken);
    assert_eq!(stats.received + stats.unwanted + stats.malformed + stats.fragments, all);
    assert!(receiver.rejections().len() <= 9);
    assert_eq!(receiver.rejections().is_empty(), stats.last_rejected.is_none());
});
