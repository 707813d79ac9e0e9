//! Hostile datagrams for the bus of C#, whose transport is our own: modules in C, C++, Java and Python have that of the
//! official library.

use crate::built::Built;
use crate::support;
use std::process::Command;

/// 100,000 mutated datagrams, and fragments that would take any memory; `csharp/Hostile.cs` judges.
#[test]
fn hostile_datagrams_end_no_program_in_csharp_take_bounded_memory_and_hold_back_no_message() {
    let Some(built) = Built::in_csharp() else { return };
    let _turn = support::turn();
    let url = format!("udpm://239.255.76.67:{}?ttl=0", support::unique_port());
    let command = built.command(("csharp", "hostile"));
    let output = Command::new(&command[0]).args(&command[1..]).env("LCM_DEFAULT_URL", url).output().expect("it runs");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    println!("{out}");
    assert!(output.status.success(), "{out}{err}");
}
