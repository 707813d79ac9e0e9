#!/bin/sh
# The fan controller over i2c-dev, on an adapter of the kernel's with models/i2c_usb.py at its other end: the tools read and
# write it; the robot's driver configures it, reads it, and tells what breaks and that it is over.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. lab/checks/i2c_adapter.sh
needs i2cget i2cset

reads() { # REGISTER VALUE: so the chip has it, past our driver
    is=$(i2cget -y "${adapter#*-}" 0x18 "$1")
    [ "$is" = "$2" ] || fail "register $1 reads $is, not $2"
}

configured() { # as robot.toml has it
    reads 0x02 0x1e # both outputs inverted, start duty below the start temperature, channel 2 is the chip's own
    reads 0x03 0x3c # limits: 60, 75 C
    reads 0x04 0x4b
    reads 0x07 0x30 # start duty: 20 % of 240
    reads 0x0f 0x23 # start temperatures: 35, 45 C
    reads 0x10 0x2d
    reads 0x11 0x3c # both fans follow both channels
    reads 0x13 0xaa # 4 % of 240 a degree
    reads 0x1a 0x90 # 400 rpm are 57600/400 counts
}

tool() { # TEXT COMMAND...: the tool says the text, however it ends
    text=$1
    shift
    "$ADVEE" i2c "$@" --port "$adapter" >"$HOME/tool" 2>&1 || true
    grep -q -e "$text" "$HOME/tool" || fail "advee i2c $* said: $(cat "$HOME/tool")"
}

step "the tools"
tool "^0x18 .*max6615" scan
i2cset -y "${adapter#*-}" 0x18 0x0f 0x2d
tool "0x2d  45 °C" get 0x18 0x0f
tool "0x50  80 °C" set 0x18 0x03 0x50
reads 0x03 0x50
tool "^0f  2d\* fan-start temperature 1" dump 0x18
tool "nobody answers at this address" get 0x19 0
tool "cannot read a block of variable length" get 0x18 0 --block

step "the robot configures and reads it"
"$ADVEE" run driver_aux --set i2c.aux.bus="$adapter" >"$log" 2>&1 &
driver=$!
expect "fan1 (0x18 on i2c.aux): MAX6615 revision 1, configured"
configured
told 'name="box" value=25.0'
tool "is held by driver_aux" dump 0x18

step "a fan stalls: the other one helps"
model stall 1
expect "fan_left failed: 0 rpm at"
# It gets there by its rate of change.
full() { [ "$(i2cget -y "${adapter#*-}" 0x18 0x0e)" = 0xf0 ]; }
within 20 full || fail "the other fan is not driven to full duty"
model turn 1
expect "fan_left turns again: "

step "too hot"
model hot 1 70
expect "box is at 70.0 °C, above its limit of 60 °C"
model hot 1 25
expect "box is at 25.0 °C, below its limit of 60 °C"

step "the chip loses its supply"
model gone
expect "fan1 (0x18 on i2c.aux): nobody answers at this address; retried once a second"
sleep 3
once "fan1 (0x18 on i2c.aux): nobody answers"
model back
expect "fan1 (0x18 on i2c.aux) answers again"
configured
step "for a moment"
model reset
expect "had lost its configuration: configured again"
configured

step "SDA is held low"
model sda low
expect "fan1 (0x18 on i2c.aux): register 02 was given 1e and reads 00; retried once a second"
model sda free
expect "fan1 (0x18 on i2c.aux) answers again"

step "the adapter does not finish a transfer"
model scl low
expect "fan1 (0x18 on i2c.aux): the adapter does not finish a transfer"
model scl free
expect "fan1 (0x18 on i2c.aux) answers again"

step "the adapter is pulled"
model unplug
expect "i2c.aux is down: the adapter is gone"
within 10 no_adapter || fail "it is still there"
model plug
expect "i2c.aux is up"
expect "fan1 (0x18 on i2c.aux): MAX6615 revision 1, configured"
find_adapter && configured
step "while it hangs"
model scl low
expect "the adapter does not finish a transfer"
model unplug
expect "i2c.aux is down: "
within 10 no_adapter || fail "it is still there"
model scl free
model plug
expect "fan1 (0x18 on i2c.aux): MAX6615 revision 1, configured"

step "end"
kill $driver
wait $driver || fail "exit code $?"
