//! A datagram from anybody, through the receiver that every process has.
#![no_main]
use lcm::receiver::Receiver;
use std::net::{Ipv4Addr, SocketAddrV4};

libfuzzer_sys::fuzz_target!(|datagrams: Vec<&[u8]>| {
    let mut receiver = Receiver::default();
    receiver.subscribe("LL_.*").expect("a good pattern");
    for datagram in datagrams {
        let _ = receiver.handle_rx(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1), datagram);
    }
});
