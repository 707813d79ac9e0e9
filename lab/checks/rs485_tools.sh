#!/bin/sh
# `advee rs485` over a kernel's serial ports, with boards that were written from docs/facts/boards.md alone: three of
# them on one bus with a terminal each, addressed by words marked in parity; they drop a frame with a gap, as real ones
# do.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
master=/dev/ttyLAB15

board() { # PORT ADDRESS
    python3 lab/models/board9.py "/dev/ttyLAB$1" "$2" >"$HOME/board$1" &
    within 30 grep -q ready "$HOME/board$1" || fail "the board at $1 does not start"
}

rs485() { # EXIT-STATUS COMMAND...: at our port; what it says goes to $log
    expected=$1 status=0
    shift
    "$ADVEE" rs485 "$@" --port $master --transport parity >"$log" 2>&1 || status=$?
    [ $status = "$expected" ] || fail "advee rs485 $*: exit status $status"
}

says() { grep -e "$1" "$log" || fail "not in the output: $1"; } # TEXT

board 16 0x20
board 17 0x11
board 18 0xfe # an address that is nearly a mark
step "three boards on one bus, each with its address"
rs485 0 scan --first 16 --last 33
says "^0x11 .* 1\.2 "
says "^0x20 .* 1\.2 "
says "2 boards on $master; 18 addresses asked"
rs485 0 version 0xfe
says "board 0xfe: version 1.2, then \[fe\]"

step "the time of a poll, and of the wire alone"
rs485 0 poll 0x20 version --count 20
says "good .* 20  100.00 %"
says "round trip"

step "a listener for both directions"
"$ADVEE" rs485 monitor --port /dev/ttyLAB19 --transport parity --for 3 >"$HOME/heard" 2>&1 &
monitor=$!
sleep 0.5
rs485 0 version 0x11
wait $monitor || fail "the listener: exit status $?"
cat "$HOME/heard"
grep -q "1 requests, 1 good answers, 0 damaged" "$HOME/heard" || fail "the listener did not receive it"

step "another rate"
rs485 1 scan --first 16 --last 18 --baud 57600
says "nobody answers: power, wires, A and B, baud"

step "two boards with one address collide"
board 19 0x11
rs485 0 scan --first 16 --last 18
says "^0x11 .*damaged: .*two boards at one address?"

! grep -h dropped "$HOME"/board* || fail "a frame had a gap"

step "the port switches the direction of the line, as far as it can"
"$ADVEE" rs485 version 0x20 --bus b --set rs485.b.port=$master --set rs485.b.transport=parity \
    --set rs485.b.rs485_direction.delay_before_ms=2 >"$log" 2>&1 || fail "exit status $?"
says "version 1.2"
"$ADVEE" rs485 version 0x20 --bus b --set rs485.b.port=$master --set rs485.b.transport=parity \
    --set rs485.b.rs485_direction.delay_after_ms=2 >"$log" 2>&1 && fail "a delay that the port cannot make is not refused"
says "rs485_direction: the port makes something else of it"
