//! Both ends of a connection on the loopback interface.

use super::*;
use crate::clock;
use crate::ports::{Port, PortConfig, PortState};

const ANY: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 0);

/// Waits for the descriptor, and reads once.
fn receive(device: &mut impl Device) -> Result<Vec<u8>, Lost> {
    loop {
        let fd = device.fd().expect("it is open");
        poll(&mut [PollFd::new(fd, PollFlags::POLLIN)], PollTimeout::from(5000_u16)).unwrap();
        if let Received::Input { input: Input::Words(words), .. } = device.receive(clock::now())? {
            assert!(words.iter().all(|word| !word.ninth));
            return Ok(words.iter().map(|word| word.byte).collect());
        }
    }
}

fn words(bytes: &[u8]) -> Output {
    Output::Words(bytes.iter().copied().map(Word::data).collect())
}

fn open(client: &mut Client) -> Result<(), Lost> {
    loop {
        match client.open() {
            Err(_) if client.is_preparing() => std::thread::yield_now(),
            result => return result,
        }
    }
}

/// Accepts a connection that was made.
fn accept(server: &mut Server) {
    while !server.is_connected() {
        server.receive(clock::now()).unwrap();
    }
}

#[test]
fn bytes_cross_in_both_directions_and_each_output_has_its_end() {
    let mut server = Server::new(ANY);
    server.open().unwrap();
    let mut client = Client::new(server.listens().unwrap());
    open(&mut client).unwrap();
    let now = clock::now();
    assert_eq!(client.send(now, &words(&[0, 1, 255])), Ok(true));
    assert_eq!((client.sent_at(), client.take_sent(now), client.take_sent(now)), (Some(now), true, false));
    assert_eq!(receive(&mut server).unwrap(), [0, 1, 255]);
    assert_eq!(server.send(now, &words(&[7])), Ok(true));
    assert!(server.take_sent(now));
    assert_eq!(receive(&mut client).unwrap(), [7]);
}

#[test]
fn a_refused_connection_is_an_error_that_names_the_device() {
    let mut server = Server::new(ANY);
    server.open().unwrap();
    let address = server.listens().unwrap();
    server.close();
    let why = open(&mut Client::new(address)).unwrap_err();
    assert!(why.starts_with(&format!("{address}: ")) && why.contains("refused"), "{why}");
}

#[test]
fn a_connection_that_ends_is_lost_and_the_server_takes_another() {
    let mut server = Server::new(ANY);
    server.open().unwrap();
    let address = server.listens().unwrap();
    let (mut first, mut second) = (Client::new(address), Client::new(address));
    open(&mut first).unwrap();
    accept(&mut server);
    open(&mut second).unwrap();
    second.send(clock::now(), &words(&[9])).unwrap();
    assert_eq!(receive(&mut server).unwrap(), [9]);
    assert!(receive(&mut first).unwrap_err().contains("closed the connection"), "the newest one counts");
    second.close();
    let mut third = Client::new(address);
    open(&mut third).unwrap();
    third.send(clock::now(), &words(&[3])).unwrap();
    assert_eq!(receive(&mut server).unwrap(), [3]);
}

#[test]
fn a_peer_that_does_not_read_fills_a_bounded_queue() {
    let mut server = Server::new(ANY);
    server.open().unwrap();
    let mut client = Client::new(server.listens().unwrap());
    open(&mut client).unwrap();
    accept(&mut server);
    let now = clock::now();
    let output = words(&[0x55; 4096]);
    let mut sent = 0;
    while client.send(now, &output) == Ok(true) {
        client.take_sent(now);
        sent += 1;
        assert!(sent < 100_000, "without end");
    }
    assert!(client.wants_to_write() && client.stream.as_ref().unwrap().queue.len() <= QUEUE_MAX);
}

#[test]
fn a_device_that_takes_requests_and_never_answers_is_lost() {
    let mut server = Server::new(ANY);
    server.open().unwrap();
    let mut client = Client::new(server.listens().unwrap());
    open(&mut client).unwrap();
    accept(&mut server);
    let now = clock::now();
    assert_eq!(client.send(now, &words(&[1])), Ok(true));
    assert_eq!(client.send(now + UNANSWERED_FOR, &words(&[2])), Ok(true));
    assert_eq!(server.send(now, &words(&[7])), Ok(true));
    assert_eq!(receive(&mut client).unwrap(), [7]);
    let again = now + UNANSWERED_FOR + Duration::from_secs(1);
    assert_eq!(client.send(again, &words(&[3])), Ok(true), "it has answered");
    let why = client.send(again + UNANSWERED_FOR + Duration::from_millis(1), &words(&[4])).unwrap_err();
    assert!(why.contains("does not answer"), "{why}");
    client.close();
    open(&mut client).unwrap();
    assert_eq!(client.send(again + UNANSWERED_FOR * 2, &words(&[5])), Ok(true), "a new connection");
}

#[test]
fn a_port_of_a_device_that_comes_later_opens_by_itself() {
    let mut server = Server::new(ANY);
    server.open().unwrap();
    let address = server.listens().unwrap();
    server.close();
    let mut port = Port::new("io.plc".into(), PortConfig::Tcp { address });
    let reported = std::iter::repeat_with(|| port.try_open(clock::now())).flatten().next();
    assert!(matches!(reported, Some(Err(_))), "told once");
    let mut server = Server::new(address);
    server.open().unwrap();
    while port.state != PortState::Up {
        let _ = port.try_open(clock::now());
    }
}
