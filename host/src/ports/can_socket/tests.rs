//! The device on sockets that every kernel has.

use super::*;
use base::can::Id;
use std::net::{Ipv4Addr, UdpSocket};

/// The interface with one end of a UDP connection as its socket, which counts losses like a CAN socket.
fn connected() -> (CanSocket, UdpSocket) {
    let [ours, peer] = [(); 2].map(|()| UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap());
    ours.connect(peer.local_addr().unwrap()).unwrap();
    peer.connect(ours.local_addr().unwrap()).unwrap();
    ours.set_nonblocking(true).unwrap();
    setsockopt(&ours, sockopt::RxqOvfl, &1).unwrap();
    setsockopt(&ours, sockopt::ReceiveTimestampns, &true).unwrap();
    let mut port = CanSocket::new("lo".into());
    port.socket = Some(ours.into());
    (port, peer)
}

#[test]
fn frames_that_found_the_buffer_full_are_counted_and_the_others_come_in_order() {
    const SENT: u32 = 1000;
    let (mut port, peer) = connected();
    setsockopt(port.socket.as_ref().unwrap(), sockopt::RcvBuf, &0).unwrap();
    let send = |id: u32| peer.send(&encode(&Frame::standard(id as u16, &[0; 8]))).unwrap();
    (0..SENT).for_each(|id| assert_eq!(send(id), FRAME));
    let (mut got, mut lost, mut told) = (Vec::new(), Vec::new(), 0);
    let mut drain = |port: &mut CanSocket| loop {
        match port.receive(Instant::ZERO).unwrap() {
            Received::Nothing => break,
            Received::Input { input: Input::Can { frame, .. }, .. } => got.push(frame.id()),
            Received::Fault(Fault::PortOverrun, why) => lost.push(why),
            Received::Input { input: Input::CanNotice(Notice::Lost(count)), .. } => told += count,
            _ => panic!(),
        }
    };
    drain(&mut port);
    // Losses are reported together with the next frame.
    send(SENT);
    drain(&mut port);
    let count = SENT as usize + 1 - got.len();
    assert!(count > 0 && got.is_sorted(), "{got:?}");
    assert_eq!(lost, [format!("lo: the receive buffer overflowed: {count} frames are lost")]);
    assert_eq!((got.last(), told as usize), (Some(&Id::Standard(SENT as u16)), count));
}

/// An error frame of the kernel: class, data.
fn error(class: u32, data: u64) -> [u8; FRAME] {
    let mut raw = [0; FRAME];
    raw[..4].copy_from_slice(&(0x2000_0000 | class).to_ne_bytes());
    raw[4] = 8;
    raw[8..].copy_from_slice(&data.to_be_bytes());
    raw
}

/// Results of reading the port now, as text.
fn drain(port: &mut CanSocket, now: Instant) -> Vec<String> {
    let mut told = Vec::new();
    loop {
        told.push(match port.receive(now) {
            Ok(Received::Nothing) => return told,
            Ok(Received::Input { input: Input::CanNotice(Notice::Health(health)), .. }) => {
                format!("{:?} {} {}", health.state, health.transmit_errors, health.receive_errors)
            }
            Ok(Received::Input { input: Input::CanNotice(notice), .. }) => format!("{notice:?}"),
            Ok(Received::Input { input: Input::Can { frame, .. }, .. }) => format!("{:?}", frame.data()),
            Ok(Received::Note(note)) => note,
            Ok(Received::Fault(_, why)) => why,
            Ok(Received::Input { .. }) => panic!(),
            Err(why) => {
                port.close();
                format!("down: {why}")
            }
        });
    }
}

#[test]
fn error_frames_become_notices_at_a_limited_rate() {
    let (mut port, peer) = connected();
    let now = Instant::from_millis(1000);
    let send = |raw: [u8; FRAME]| peer.send(&raw).unwrap();
    // A bus error in the data, three times; a missing acknowledgement, twice.
    for _ in 0..3 {
        send(error(0x88, 0x0000_040A_0000_0000));
    }
    for _ in 0..2 {
        send(error(0x20, 0));
    }
    send(error(0x204, 0x0020_0000_0000_8000));
    send(encode(&Frame::standard(0x181, &[7])));
    assert_eq!(drain(&mut port, now), ["Errors(1)", "Passive 128 0", "[7]"]);
    send(error(0x20, 0));
    assert_eq!(drain(&mut port, now + REPORT_INTERVAL), ["NoAcknowledge"]);
    send(encode(&Frame::standard(0x181, &[8])));
    assert_eq!(drain(&mut port, now + 2 * REPORT_INTERVAL), ["Errors(2)", "[8]"], "the unreported ones");
    send(error(0x204, 0x0001_0000_0000_0000));
    let ran_over = "the controller's receive buffer overflowed";
    assert_eq!(drain(&mut port, now + 2 * REPORT_INTERVAL), [ran_over, "Active 0 0", "Lost(1)"]);
    send(error(0x240, 0x0000_0000_0000_F800));
    assert_eq!(drain(&mut port, now), ["Off 248 0", "down: lo: bus-off"]);
}

#[test]
fn a_frame_has_the_receive_time_of_the_kernel() {
    let (mut port, peer) = connected();
    // The kernel starts to stamp shortly after the request.
    std::thread::sleep(Duration::from_millis(100));
    let before = clock::now();
    peer.send(&encode(&Frame::standard(0x181, &[]))).unwrap();
    let after = clock::now();
    std::thread::sleep(Duration::from_millis(30));
    let Ok(Received::Input { input: Input::Can { at: arrived, .. }, stamp: Some(_), .. }) = port.receive(clock::now())
    else {
        panic!("a frame with the kernel's time")
    };
    let slack = Duration::from_millis(10);
    assert!(arrived + slack >= before && arrived <= after + slack, "{before:?} {arrived:?} {after:?}");
}

#[test]
fn a_wrong_bit_rate_is_reported_and_an_unknown_one_accepted() {
    let mut port = CanSocket::new("can0".into());
    port.expect(Line::Can { bitrate: 1_000_000 }, false);
    let at = |bitrate| Link { bitrate, ..Link::default() };
    assert_eq!(port.check_bitrate(&at(None)), Ok(()));
    assert_eq!(port.check_bitrate(&at(Some(1_000_000))), Ok(()));
    let why = port.check_bitrate(&at(Some(500_000))).unwrap_err();
    assert!(why.starts_with("can0: runs at 500000 bit/s, the bus is configured for 1000000"), "{why}");
    assert!(!why.contains('\n'));
}

#[test]
fn a_controller_that_the_kernel_restarts_is_waited_for() {
    let mut port = CanSocket::new("can0".into());
    let off = Health { state: BusState::Off, ..Health::default() };
    let link = |health, restart_ms| Link { health, restart_ms, ..Link::default() };
    let now = Instant::from_millis(1);
    let by_itself = port.restart_controller(now, &link(Some(off), Some(100)));
    assert_eq!(by_itself, Err("can0: bus-off; the kernel restarts it after 100 ms (restart-ms)".into()));
    assert_eq!(port.restart_controller(now, &link(Some(off), Some(0))), Err("can0: bus-off".into()));
    assert_eq!(port.restart_controller(now, &link(Some(Health::default()), Some(0))), Ok(()));
    assert_eq!(port.restart_controller(now, &Link::default()), Ok(()));
}

#[test]
fn frames_that_the_kernel_does_not_take_are_queued_in_order() {
    // A socket pair that holds few messages.
    let (ours, peer) = nix::sys::socket::socketpair(
        nix::sys::socket::AddressFamily::Unix,
        nix::sys::socket::SockType::SeqPacket,
        None,
        nix::sys::socket::SockFlag::SOCK_NONBLOCK,
    )
    .unwrap();
    setsockopt(&ours, sockopt::SndBuf, &0).unwrap();
    let mut port = CanSocket::new("lo".into());
    port.socket = Some(ours);
    let now = Instant::from_millis(1000);
    let frame = |n: u8| Output::Can(Frame::standard(0x600, &[n]));
    let mut sent = 0;
    while !port.wants_to_write() {
        assert_eq!(port.send(now, &frame(sent)), Ok(true));
        sent += 1;
    }
    assert_eq!(port.send(now, &frame(sent)), Ok(true));
    let take = || {
        let mut raw = [0; FRAME];
        nix::unistd::read(&peer, &mut raw).map(|_| raw[8])
    };
    assert_eq!(take(), Ok(0));
    let mut next = 1;
    while port.wants_to_write() {
        port.on_writable(now).unwrap();
        assert_eq!(take(), Ok(next));
        next += 1;
    }
    while let Ok(n) = take() {
        assert_eq!(n, next);
        next += 1;
    }
    assert_eq!(next, sent + 1);
    // If nothing leaves, pending frames are dropped.
    while !port.wants_to_write() {
        assert_eq!(port.send(now, &frame(0)), Ok(true));
    }
    port.on_writable(now + Duration::from_millis(51)).unwrap();
    assert!(!port.wants_to_write());
}

#[test]
fn a_socket_with_an_error_pending_is_not_up() {
    let (port, peer) = connected();
    let socket = port.socket.as_ref().unwrap();
    assert_eq!(port.check(socket), Ok(()));
    drop(peer);
    write(socket, b"to nobody").unwrap();
    assert_eq!(port.check(socket), Err(format!("lo: {}", Errno::ECONNREFUSED.desc())));
    assert_eq!(port.check(socket), Ok(()), "reported once");
}

#[test]
fn a_frame_of_invalid_length_closes_the_port() {
    let (mut port, peer) = connected();
    peer.send(&[0; FRAME - 1]).unwrap();
    assert_eq!(port.receive(Instant::ZERO).err().unwrap(), "lo: frames of invalid length");
}

#[test]
fn a_missing_interface_is_reported_in_one_line() {
    let reason = CanSocket::new("can_not_here".into()).open().unwrap_err();
    assert_eq!(reason, "can_not_here: there is no such interface");
}
