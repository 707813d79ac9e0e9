#!/bin/sh
# The whole robot over a kernel's serial ports: buses of 9-bit words with addresses in mark parity, on wires with real
# timing. It runs and drives; a board falls silent and returns.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/rs485_lib.sh"
warm

set_ports() { # BUS=N...: the driver's port is /dev/ttyLABN, the simulator's boards are at the next one
    for bus; do
        n=${bus#*=} bus=rs485.${bus%=*}
        echo "--set $bus.port=/dev/ttyLAB$n --set $bus.simulated_at=/dev/ttyLAB$((n + 1)) --set $bus.transport=parity"
    done
}

step "start"
# Boards discard a frame after a gap of 5 ms, which may occur in a process without priority.
rt_priorities driver_rs485a=42 driver_rs485b=42 driver_power=42 simulator=40
"$ADVEE" --config "$HOME/conf/advee" up --headless --sim --run-dir /run/advee --set web.enabled=false \
    --set rs485.a.rs485_direction.rts_on_send=true $(set_ports a=0 b=5 power=10) >>"$log" 2>&1 &
up=$!
expect "the steering is homed" 60
has_priorities

# Ignores the start, when four processes with priorities and locked memory delay each other.
step "drive"
before=$(errors a)
drive
load
[ "$(errors a)" = "$before" ] || fail "an undisturbed wire has errors"
all_run || fail "$("$ADVEE" state)"
[ "$(count "driver_.* ms after an address")" = 0 ] || fail "frames have gaps"

step "the port switches the direction of the line as configured"
python3 -c 'import fcntl, os, struct
port = os.open("/dev/ttyLAB0", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
told = struct.unpack("8I", fcntl.ioctl(port, 0x542E, bytes(32)))[:3]
print("TIOCGRS485", told)
assert told == (0b011, 0, 0)' || fail "TIOCGRS485 returns another setting"

step "a board falls silent, and returns"
"$ADVEE" fault so1 silent --for 3
expect "so1 (0x20 on rs485.a) does not answer: its data is invalid"
expect "so1 (0x20 on rs485.a) answers again"
once "its data is invalid"
drive

kill -INT $up
wait $up || fail "exit code $?"
