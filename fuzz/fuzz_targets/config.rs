//! A configuration file.
#![no_main]
libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = robot::config::parse("fuzz.toml", text);
});
