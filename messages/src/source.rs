//! Names of sources of commands, as people call them.

/// Name of the device, terminal or tool that sends commands under this name; any other name as it is.
///
/// Who speaks for a person makes the name: the web server `web:` and the name of the device, `advee diag` `diag:` and
/// its process, other tools their own, `@`, the computer, `:` and their process. `LL_DATA_MOTION`, `LL_DATA_HOLD` and
/// `CM_CMD_STATE` carry it; programs compare it as it is, and only people read what this returns.
///
/// ```
/// assert_eq!(messages::source_in_words("web:Jana's phone"), "Jana's phone (web)");
/// assert_eq!(messages::source_in_words("drive@robot:812"), "advee drive on robot");
/// ```
#[must_use]
pub fn source_in_words(name: &str) -> String {
    if let Some(device) = name.strip_prefix("web:").filter(|device| !device.is_empty()) {
        return format!("{device} (web)");
    }
    if name.strip_prefix("diag:").is_some_and(is_process) {
        return "a terminal (advee diag)".into();
    }
    let tool = name.split_once('@').and_then(|(tool, place)| Some((tool, place.rsplit_once(':')?)));
    match tool {
        Some((tool, (computer, process))) if is_command(tool) && is_process(process) => {
            let place = if computer.is_empty() { String::new() } else { format!(" on {computer}") };
            format!("advee {tool}{place}")
        }
        _ => name.into(),
    }
}

fn is_process(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

fn is_command(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_named_as_people_call_it_and_any_other_name_stays() {
        for (name, words) in [
            ("web:Linux computer", "Linux computer (web)"),
            ("web:a@b:1", "a@b:1 (web)"),
            ("diag:6323", "a terminal (advee diag)"),
            ("drive@robot:812", "advee drive on robot"),
            ("state@fe80::1:7", "advee state on fe80::1"),
            ("goal@:7", "advee goal"),
            ("planner", "planner"),
            ("gamepad", "gamepad"),
            ("ros2", "ros2"),
            ("", ""),
            ("web:", "web:"),
            ("diag:", "diag:"),
            ("diag:x", "diag:x"),
            ("Drive@robot:8", "Drive@robot:8"),
            ("drive@robot", "drive@robot"),
            ("drive@robot:x", "drive@robot:x"),
            ("@robot:8", "@robot:8"),
        ] {
            assert_eq!(source_in_words(name), words, "{name}");
        }
    }
}
