//! Emulated lidars for tests, each at the other end of a port: a pseudo-terminal or a TCP connection.

use ::lidar::emulated::Device;
use base::serial::Word;
use host::clock;
use host::ports::{Port, PortConfig, Received};
use module::{Input, Output};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, mpsc};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::Duration;

/// A device that is served by a thread until this is dropped.
pub struct Served {
    /// The port as a person names it.
    pub port: String,
    folder: PathBuf,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Served {
    /// A device on a pseudo-terminal.
    pub fn serial(device: impl FnOnce() -> Box<dyn Device> + Send + 'static) -> Self {
        let folder = Self::folder();
        let link = folder.join("line");
        let port = link.display().to_string();
        Self::new(folder, port, PortConfig::PseudoBytes { link, baud: 1_000_000 }, device)
    }

    /// A device on a TCP connection.
    pub fn tcp(device: impl FnOnce() -> Box<dyn Device> + Send + 'static) -> Self {
        let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port").local_addr().expect("bound").port();
        let address: SocketAddr = (Ipv4Addr::LOCALHOST, free).into();
        Self::new(Self::folder(), address.to_string(), PortConfig::TcpServer { address }, device)
    }

    fn folder() -> PathBuf {
        static NEXT: AtomicU16 = AtomicU16::new(0);
        let name = format!("advee-lidar-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).expect("a folder");
        folder
    }

    fn new(
        folder: PathBuf,
        port: String,
        config: PortConfig,
        device: impl FnOnce() -> Box<dyn Device> + Send + 'static,
    ) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, (opened, is_open)) = (stop.clone(), channel());
        let thread = spawn(move || serve(config, device(), &stopped, &opened));
        is_open.recv().expect("the port can be opened");
        Self { port, folder, stop, thread: Some(thread) }
    }
}

fn serve(config: PortConfig, mut device: Box<dyn Device>, stop: &AtomicBool, opened: &mpsc::Sender<()>) {
    let mut port = Port::new("lidar".into(), config);
    port.device.open().expect("it can be opened");
    opened.send(()).expect("the test waits for it");
    while !stop.load(Ordering::Relaxed) {
        let now = clock::now();
        while let Ok(Received::Input { input: Input::Words(words), .. }) = port.device.receive(now) {
            let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
            device.handle_rx(now, &bytes);
        }
        device.handle_timeout(now);
        let mut bytes = [0; 4096];
        let count = device.poll_tx(now, &mut bytes);
        if count > 0 {
            // Without a client nothing arrives anywhere.
            let _ = port.device.send(now, &Output::Words(bytes[..count].iter().copied().map(Word::data).collect()));
        }
        if port.device.wants_to_write() {
            let _ = port.device.on_writable(now);
        }
        while port.device.take_sent(now) {}
        sleep(Duration::from_micros(500));
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
