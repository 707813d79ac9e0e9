//! Publishers of `/cmd_vel`: one on the crate `rtps`, in this process, and one on rclpy.

use crate::support;
use base::{Duration, Instant};
use host::clock;
use rtps::{Limits, Participant, Prefix, Qos, WriterId};
use std::io::{BufRead, BufReader, Lines, Write};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// Programs of a domain that the robot looks for on its computer; it is the first one itself.
const PROGRAMS: u32 = 10;
const ANNOUNCED: Duration = Duration::from_secs(1);
/// Time after which the robot forgets a publisher that was killed.
const LEASE: Duration = Duration::from_secs(10);
/// Longest datagram of UDP, bytes.
const DATAGRAM_MAX: usize = 65_507;

/// Participant of this process. The end of its value is that of a process that is killed: it does not say that it
/// leaves.
pub struct Publisher {
    participant: Participant,
    writer: WriterId,
    socket: UdpSocket,
    datagram: Vec<u8>,
}

impl Publisher {
    /// Joins the domain of a robot at the loopback address.
    pub fn new(domain: u32) -> Self {
        let address = |n| Some(SocketAddrV4::new(Ipv4Addr::LOCALHOST, rtps::unicast_port(domain, n)?));
        let open = |n| {
            let own = address(n)?;
            Some((UdpSocket::bind(own).ok()?, own))
        };
        let (socket, own) = (1..PROGRAMS).find_map(open).expect("a port is free");
        socket.set_nonblocking(true).expect("non-blocking");
        let mut participant = Participant::new(rtps::Config {
            domain,
            prefix: prefix(),
            locators: vec![own],
            announce_to: address(0).into_iter().collect(),
            announce_period: ANNOUNCED,
            lease: LEASE,
            name: "bench".into(),
            user_data: b"enclave=/;".to_vec(),
            endpoint_data: |_| Vec::new(),
            limits: Limits::default(),
        });
        // As `create_publisher` with a depth of 1.
        let qos = Qos { depth: 1, ..Qos::RELIABLE };
        let writer = participant.add_writer(clock::now(), "rt/cmd_vel", "geometry_msgs::msg::dds_::Twist_", qos);
        let writer = writer.expect("short names");
        Self { participant, writer, socket, datagram: vec![0; DATAGRAM_MAX] }
    }

    /// True if somebody listens.
    pub fn is_heard(&self) -> bool {
        self.participant.matched(self.writer) > 0
    }

    /// Receives, does what is due, and sends.
    pub fn serve(&mut self) {
        while let Ok((length, from)) = self.socket.recv_from(&mut self.datagram) {
            if let SocketAddr::V4(from) = from {
                self.participant.handle_rx(clock::now(), from, &self.datagram[..length]);
            }
        }
        self.participant.handle_timeout(clock::now());
        self.send();
    }

    /// Publishes a speed, m/s.
    pub fn publish(&mut self, vx: f64) {
        let mut cdr: Vec<u8> = vec![0, 1, 0, 0];
        for component in [vx, 0.0, 0.0, 0.0, 0.0, 0.0] {
            cdr.extend(component.to_le_bytes());
        }
        let micros = (clock::wall() / 1000).cast_signed();
        self.participant.write(clock::now(), self.writer, micros, &cdr);
        self.send();
    }

    fn send(&mut self) {
        while let Some(transmit) = self.participant.poll_tx() {
            let _ = self.socket.send_to(&transmit.datagram, transmit.to);
        }
    }
}

impl AsFd for Publisher {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

/// Another identifier for each publisher.
fn prefix() -> Prefix {
    let mut prefix = [0; 12];
    prefix[..8].copy_from_slice(&clock::now().as_nanos().to_le_bytes());
    prefix[8..].copy_from_slice(&std::process::id().to_le_bytes());
    Prefix(prefix)
}

/// Process with rclpy on Fast DDS, `publisher.py`; it ends with this value.
pub struct Rclpy {
    child: Child,
    input: ChildStdin,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Rclpy {
    /// Starts it, and waits until it has found the robot.
    ///
    /// # Errors
    /// One line: rclpy is not installed, or it does not find the robot.
    pub fn start(domain: u32) -> Result<Self, String> {
        let python = testing::python(&["rclpy", "geometry_msgs"])?;
        let mut command = Command::new(python);
        command.arg(support::workspace().join("benches/ros2/publisher.py")).arg(domain.to_string());
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("python is there");
        let input = child.stdin.take().expect("it is piped");
        let lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
        let mut rclpy = Self { child, input, lines };
        rclpy.number().ok_or("it does not find the robot")?;
        Ok(rclpy)
    }

    /// Publishes a speed, m/s; the time right before that, by the process itself.
    pub fn publish(&mut self, vx: f64) -> Instant {
        self.input.write_all(format!("{vx}\n").as_bytes()).expect("rclpy listens");
        Instant::from_nanos(self.number().expect("rclpy answers"))
    }

    /// Next line that is a number.
    fn number(&mut self) -> Option<u64> {
        self.lines.by_ref().map_while(Result::ok).find_map(|line| line.parse().ok())
    }
}

impl Drop for Rclpy {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
