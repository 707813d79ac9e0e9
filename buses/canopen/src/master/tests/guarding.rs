//! Node guarding by the master.

use super::*;

const GUARDED: &str = "
          0ms < 77F 05
          0ms < 000 82 01
          5ms > 701 00
          5ms < 601 40 00 10 00 00 00 00 00
          6ms > 581 43 00 10 00 92 01 02 00
          6ms < 601 40 18 10 04 00 00 00 00
          6ms > 581 80 18 10 04 11 00 09 06
          6ms < 601 40 17 10 00 00 00 00 00
          7ms > 581 4B 17 10 00 00 00 00 00     # no heartbeat already
          7ms < 601 40 0C 10 00 00 00 00 00
          8ms > 581 4B 0C 10 00 00 00 00 00
          8ms < 601 2B 0C 10 00 64 00 00 00
          9ms > 581 60 0C 10 00 00 00 00 00
          9ms < 601 40 0C 10 00 00 00 00 00
         10ms > 581 4B 0C 10 00 64 00 00 00
         10ms < 601 40 0D 10 00 00 00 00 00
         11ms > 581 4F 0D 10 00 03 00 00 00
         11ms < 701 R
         12ms > 701 7F
         12ms < 000 01 01
        111ms < 701 R
        112ms > 701 85
        112ms < booted 1
        112ms < Ready
        211ms < 701 R
        212ms > 701 05
        311ms < 701 R
";

fn master() -> Master {
    let guarding = Guarding { period: Duration::from_millis(100), factor: 3 };
    let config = MasterConfig { heartbeat: Duration::from_secs(60), ..MasterConfig::default() };
    Master::new(config, &[NodeConfig { guarding: Some(guarding), ..NodeConfig::new(1, "a") }]).unwrap()
}

#[test]
fn a_node_is_guarded_and_lost_when_it_does_not_answer() {
    let silent = "
        411ms < 701 R
        511ms < 701 R
        611ms < 000 82 01
        611ms < lost 1: guarding not answered
        611ms < NotReady
        700ms > 701 00
        700ms < 601 40 00 10 00 00 00 00 00
    ";
    check(&mut master(), &[GUARDED, silent].concat());
}

#[test]
fn one_answer_that_is_missed_does_no_harm() {
    let missed = "
        411ms < 701 R
        412ms > 701 05                          # it did answer the last one
        511ms < 701 R
        512ms > 701 85
        611ms < 701 R
        612ms > 701 05
        711ms < 701 R
    ";
    check(&mut master(), &[GUARDED, missed].concat());
}

#[test]
fn a_bit_that_does_not_alternate_is_no_answer() {
    let stuck = "
        312ms > 701 05                          # its last one was 05 too
        411ms < 701 R
        412ms > 701 85
        511ms < 701 R
        512ms > 701 85
        611ms < 701 R
        612ms > 701 04
        612ms < 000 82 01
        612ms < lost 1: went to Stopped
        612ms < NotReady
    ";
    check(&mut master(), &[GUARDED, stuck].concat());
}

#[test]
fn two_nodes_that_answer_one_guarding_are_told() {
    let twins = "
        312ms > 701 85
        312ms > 701 85
        411ms < 701 R
        412ms > 701 05
        412ms > 701 05
        511ms < 701 R
        512ms > 701 85
        512ms > 701 85
        611ms < 701 R
        612ms > 701 05
        612ms > 701 05
        711ms < 701 R
        712ms > 701 85
        712ms > 701 85
        811ms < 701 R
        812ms > 701 05
        812ms > 701 05
        812ms < 000 82 01
        812ms < DuplicateId { node: 1 }
        812ms < lost 1: two nodes have its id
        812ms < NotReady
    ";
    check(&mut master(), &[GUARDED, twins].concat());
}

#[test]
fn a_node_and_its_master_guard_each_other() {
    let guarding = Guarding { period: Duration::from_millis(50), factor: 3 };
    let config = NodeConfig { guarding: Some(guarding), ..NodeConfig::new(1, "a") };
    let mut bus = one(MasterConfig::default(), config, epos::dictionary(1));
    bus.run_to(500, is_booted(1));
    bus.run(5000);
    assert_eq!(told(&bus, 0), [Event::Booted { node: 1 }, Event::Ready]);
    let died = bus.now;
    bus.nodes[0].power_off();
    let lost = bus.run_to(300, |event| *event == Event::Lost { node: 1, reason: LostReason::Guarding });
    assert!(lost.since(died) <= Duration::from_millis(200), "{:?}", lost.since(died));
    bus.nodes[0].power_on(bus.now);
    bus.run_to(3000, is_booted(1));
}
