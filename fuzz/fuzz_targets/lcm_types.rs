//! A file of the type language.
#![no_main]
libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = lcm_gen::parse("fuzz.lcm", text);
});
