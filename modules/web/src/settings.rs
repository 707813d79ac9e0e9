//! `[web]`: where the robot's web server is reached, and by whom.

use ::settings::{Parsed, Section, Table, settings};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

/// Foxglove in a browser, and on the desktop.
pub const ORIGINS: [&str; 2] = ["https://app.foxglove.dev", "file://"];

settings! {
    /// `[web]`: the web server of the diagnostic center (docs/web.md), with the live endpoint for Foxglove.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct Web {
        /// The robot starts it, where `modules.toml` lists it; `advee up --headless` sets false.
        enabled: bool = true;
        /// Address and port; any other than a loopback address needs `token_file`.
        listen: SocketAddr = SocketAddr::from((Ipv4Addr::LOCALHOST, 8080)), Parsed(
            |text| text.parse().ok(), "an address and port as \"127.0.0.1:8080\" or \"[::1]:8080\"", "127.0.0.1:8080"
        );
        /// Names by which browsers may call it, besides `localhost` and the address that they reached.
        hosts: Vec<String> = Vec::<String>::new();
        /// Origins of foreign pages that may connect.
        origins: Vec<String> = ORIGINS;
        /// Maximum number of viewers at a time.
        viewers: u16 = 20, 1..=100;
        /// File with the credentials that each request must bring, of 16 to 256 characters and mode 600, from the
        /// configuration folder on. Absent: whoever reaches the loopback address may look.
        token_file: Option<PathBuf> = optional;
    }
    check Web::check;
}

impl Default for Web {
    fn default() -> Self {
        Self::usual()
    }
}

impl Web {
    fn check(&self, table: &Table<'_>) {
        if !self.listen.ip().is_loopback() && self.token_file.is_none() {
            table.refuse("listen", "a loopback address, or web.token_file beside it");
        }
        if !self.hosts.iter().all(|host| is_host(host)) {
            table.refuse("hosts", "names as \"advee.local\", without a port");
        }
        if !self.origins.iter().all(|origin| is_origin(origin)) {
            table.refuse("origins", "origins as \"https://app.foxglove.dev\", without a path");
        }
    }
}

/// A name as it stands in a request, lower case.
fn is_host(name: &str) -> bool {
    let of_a_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || ".-_".contains(c);
    name.len() <= 253 && name.chars().all(of_a_name)
}

/// As browsers send it; what any page can send ("null") is none.
fn is_origin(origin: &str) -> bool {
    let Some((scheme, authority)) = origin.split_once("://") else { return false };
    let graphic = |text: &str| text.chars().all(|c| c.is_ascii_graphic() && !c.is_ascii_uppercase());
    !scheme.is_empty() && origin.len() <= 300 && graphic(origin) && !authority.contains(['/', '*', ',', '"'])
}
