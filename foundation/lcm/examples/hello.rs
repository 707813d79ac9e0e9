//! Publishes on `HELLO` once a second and prints what comes, its own messages among it. Start it twice.

use lcm::Url;
use lcm::live::Lcm;
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut lcm = Lcm::new(&Url::default())?;
    lcm.subscribe("HELLO.*")?;
    loop {
        lcm.publish("HELLO", b"world")?;
        while lcm.wait(Duration::from_secs(1))? {
            while let Some(message) = lcm.recv()? {
                let text = String::from_utf8_lossy(message.payload);
                println!("{} {}: {text}", message.at.0, message.channel);
            }
        }
    }
}
