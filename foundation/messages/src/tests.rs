use std::collections::BTreeSet;

use super::*;

#[test]
fn no_two_channels_carry_types_that_cannot_be_told_apart() {
    let fingerprints: BTreeSet<u64> = Channel::ALL
        .iter()
        .map(|channel| channel.fingerprint())
        .collect();
    assert_eq!(fingerprints.len(), Channel::ALL.len());
}
