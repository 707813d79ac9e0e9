//! `advee power [CHANNEL [on|off|reboot]]`: shows the power channels, or switches one and waits until it is.

use super::bus::{Heard, Tool, error_of};
use super::{Common, Failed, Outcome, duration, print};
use base::{Duration, Fault as Code};
use diagnostics::orders;
use host::clock;
use messages::lowlevel::{CmdPower, DataPower};
use messages::{Channel, Hold, MOTION_MODULE, Message};
use rs485::boards::psc1::CHANNELS;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Power {
    /// Which channel; `host` off or reboot ends the modules, then the computer
    #[arg(value_parser = CHANNELS)]
    channel: Option<String>,
    /// Switch it on or off, or off and on again
    #[arg(value_parser = ["on", "off", "reboot"], requires = "channel", conflicts_with = "json")]
    action: Option<String>,
    /// A JSON object
    #[arg(long)]
    json: bool,
}

/// The driver tells once a second.
const HEARD: Duration = Duration::from_millis(2500);
/// The board switches one channel a second at most, and a restarted one rests.
const SWITCHED: Duration = Duration::from_secs(30);
const DRIVER: &str = "driver_power";

pub fn power(common: &Common, command: &Power) -> Outcome {
    let mut tool = Tool::join(common, "power", &[Channel::LlDataPower, Channel::LlDataHold, Channel::CmEventError])?;
    // Whoever is told must be there first.
    let Some(first) = heard(&mut tool, HEARD, |_| true)? else {
        // Without a power controller the motors may be fed through an output.
        if let (Some("motors"), Some("on")) = (command.channel.as_deref(), command.action.as_deref())
            && is_cut(&mut tool, HEARD, true)?
        {
            return feed(&mut tool);
        }
        let url = common.lcm_url();
        return Err(format!("no power controller is heard on {url}: this robot has none, or is advee not up?").into());
    };
    match (&command.channel, &command.action) {
        (Some(channel), Some(action)) => order(&mut tool, channel, action),
        (channel, _) => show(&first, channel.as_deref(), command.json),
    }
}

fn show(power: &DataPower, only: Option<&str>, json: bool) -> Outcome {
    let channels = || power.channels.iter().filter(|channel| only.is_none_or(|name| channel.name == name));
    if json {
        let mut shown = power.clone();
        shown.channels = channels().cloned().collect();
        print(serde_json::to_string(&shown).map_err(|error| error.to_string())?)?;
        return Ok(ExitCode::SUCCESS);
    }
    if only.is_none() {
        let left =
            if power.remaining.is_finite() { format!(", {} left", duration(power.remaining)) } else { String::new() };
        print(format_args!("battery    {:.1} V, {:.0} %{left}", power.voltage, 100.0 * power.charge))?;
    }
    for channel in channels() {
        print(format_args!(
            "{:<10} {:<3} {:.2} A",
            channel.name,
            if channel.on { "on" } else { "off" },
            channel.current
        ))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn order(tool: &mut Tool, channel: &str, action: &str) -> Outcome {
    let asked = orders::power(tool.timestamp(), channel, action)?;
    let code = asked.action;
    tool.publish(asked.clone())?;
    if asked.device == 0 && code != CmdPower::ON {
        print(format_args!("the modules are ended, then the computer"))?;
        return Ok(ExitCode::SUCCESS);
    }
    let is = |power: &DataPower, on| power.channels.iter().any(|there| there.name == channel && there.on == on);
    let mut seen = true;
    if code == CmdPower::REBOOT {
        seen = heard(tool, SWITCHED, |power| is(power, false))?.is_some();
    }
    if !seen || heard(tool, SWITCHED, |power| is(power, code != CmdPower::OFF))?.is_none() {
        return Err(format!("{channel} was not switched within {} s", SWITCHED.as_secs()).into());
    }
    print(format_args!("{channel} is {}", if code == CmdPower::OFF { "off" } else { "on" }))?;
    Ok(ExitCode::SUCCESS)
}

/// Switches the motors on where there is no power controller, and waits until they are fed.
fn feed(tool: &mut Tool) -> Outcome {
    tool.publish(orders::power(tool.timestamp(), "motors", "on")?)?;
    if !is_cut(tool, SWITCHED, false)? {
        return Err(format!("motors was not switched within {} s: the robot must stand", SWITCHED.as_secs()).into());
    }
    print(format_args!("motors is on"))?;
    Ok(ExitCode::SUCCESS)
}

/// True once `driver_canbus` says that the motors' feed is cut (`cut`), or is not; false if that is not reported in
/// time.
fn is_cut(tool: &mut Tool, time: Duration, cut: bool) -> Result<bool, Failed> {
    let until = clock::now() + time;
    let cuts = |hold: &Hold| matches!(hold, Hold::FeedCut | Hold::FeedOff);
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::LlDataHold(list)) if list.module == MOTION_MODULE => {
                if list.holds.iter().filter_map(messages::lowlevel::Hold::cause).any(|hold| cuts(&hold)) == cut {
                    return Ok(true);
                }
            }
            Heard::Message(_) => {}
            Heard::Nothing => return Ok(false),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}

/// The next message of which `is` says so; none when there was none in time.
fn heard(tool: &mut Tool, time: Duration, is: impl Fn(&DataPower) -> bool) -> Result<Option<DataPower>, Failed> {
    let until = clock::now() + time;
    let refusals = [Code::CommandForbidden as i32, Code::ChannelStuck as i32];
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::LlDataPower(power)) if is(&power) => return Ok(Some(power)),
            Heard::Message(message) => {
                if let Some(error) = error_of(&message, DRIVER)
                    && refusals.contains(&error.number)
                    && error.severity > 0
                {
                    return Err(Failed::from(error.message.clone()));
                }
            }
            Heard::Nothing => return Ok(None),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}
