#!/bin/sh
# A gamepad of the kernel's, made by uinput, drives the simulated robot: with its dead-man button only; that it is pulled
# while it drives stops the robot.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
needs python3

moves() { awk "BEGIN { exit !($(truth speed) > 0.2) }"; }
stands() { awk "BEGIN { s = $(truth speed); exit !(s < 0.01 && s > -0.01) }"; }
pad() { echo "$*" >&3; } # LINE: of advee/tests/it/gamepad/uinput.py

plug() {
    python3 advee/tests/it/gamepad/uinput.py <"$HOME/pad" &
    exec 3>"$HOME/pad"
}

# What a robot needs to drive.
awk 'BEGIN { RS = ""; ORS = "\n\n" } !/^\[\[modules/ || /name = "(simulator|driver_power|driver_rs485a|driver_canbus|driver_joydev)"/' \
    conf/advee/modules.toml >"$HOME/modules"
cat "$HOME/modules" >conf/advee/modules.toml
mkfifo "$HOME/pad"
step "start"
"$ADVEE" up --headless --sim --set 'gamepad.device="auto"' >"$log" 2>&1 &
up=$!
expect "the steering is homed" 60

step "plugged in"
plug
expect "advee uinput pad"
pad abs -20000
sleep 1
stands || fail "it drives without the dead-man button"
pad abs 0
pad key 1
sleep 0.2
pad abs -20000
within 5 moves || fail "it does not drive: $(truth speed)"
step "let go"
pad key 0
within 3 stands || fail "it drives without the dead-man button"
pad abs 0
sleep 0.2
pad key 1
sleep 0.2
pad abs -20000
within 5 moves || fail "it does not drive again: $(truth speed)"
step "pulled while it drives"
exec 3>&-
within 3 stands || fail "it drives without a gamepad"
step "and plugged in again"
plug
expect "advee uinput pad"
pad key 1
sleep 0.2
pad abs -20000
within 5 moves || fail "it does not drive again: $(truth speed)"
exec 3>&-
within 3 stands || fail "it drives without a gamepad"
kill -INT $up
wait $up || fail "exit code $?"
