//! The guard's bounds.

use super::*;

#[test]
fn a_set_point_is_within_the_bounds_of_its_direction() {
    check("guard 0.2 2 \n +10 begin pad 0.2 \n drive 0.2");
    check("begin pad 0.4 \n guard 0.2 2 \n +1 drive 0.4 \n +2 drive 0.4 ! bounded");
    check("begin pad -0.4 \n guard 0.2 2 \n +3 drive -0.4");
    check("begin pad -0.4 \n guard 2 0.2 \n +3 drive -0.4 ! bounded");
}

#[test]
fn old_bounds_permit_nothing() {
    check("begin pad 0.4 \n quiet guard \n guard 2 2 \n +151 drive 0.4 \n +2 drive 0.4 ! bounded");
    check("quiet guard \n guard 2 2 \n +200 guard 2 2 \n begin pad 0.4");
}

#[test]
fn a_driver_that_was_restarted_has_no_bounds() {
    check("quiet guard \n exit driver \n start driver \n state driver RUN \n line open \n +10 begin pad 0.4 ! bounded");
}

#[test]
fn bounds_of_another_sender_permit_nothing() {
    check("quiet guard \n +300 say pad 0 \n say pad 0.4 \n host guard 2 2 \n drive 0.4 ! bounded");
}

#[test]
fn by_hand_it_creeps_past_the_guard_while_the_second_input_is_held() {
    check("guard 0 0 \n +3 creep held \n begin pad 0.15 \n say pad 0.4 \n drive 0.2 ! bounded");
    check("quiet guard \n guard 0 0 \n creep held \n +3 begin pad 0.15 \n +243 drive 0.15 ! bounded");
}
