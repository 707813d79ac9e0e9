#!/bin/sh
# The bit-banged I2C master on two open-drain lines of the kernel's GPIO code, with models/wires.py at their far end: a
# chip, level by level. The tools read and write it; the robot's driver configures it, reads it, and reports faults and
# their end.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
needs python3

chip=$(basename "$(echo /sys/devices/platform/lab_wires/gpiochip*)")
bus=gpio:/dev/$chip:0:1

mkfifo "$HOME/model"
touch "$HOME/obeyed"
python3 lab/models/wires.py "$HOME/model" "$HOME/obeyed" &
within 30 grep -q ready "$HOME/obeyed" || fail "the model does not start"

model() { # LINE: the model does it
    : >"$HOME/obeyed"
    echo "$*" >"$HOME/model"
    within 10 grep -q -x -e "$*" "$HOME/obeyed" || fail "the model did not: $*"
}

counts() { # STARTs, STOPs and rises of SCL that the chip has seen
    : >"$HOME/obeyed"
    echo count >"$HOME/model"
    within 10 grep -q "^count: " "$HOME/obeyed" || fail "the model does not count"
    sed -n 's/^count: //p' "$HOME/obeyed"
}

tool() { # TEXT COMMAND...: the tool prints the text, however it ends
    text=$1
    shift
    "$ADVEE" i2c "$@" --port "$bus" >"$HOME/tool" 2>&1 || true
    grep -e "$text" "$HOME/tool" || fail "output of advee i2c $*: $(cat "$HOME/tool")"
}

step "lines that nobody drives are high, and only one program is at their far end"
[ "$(counts)" = "0 0 0" ] || fail "the chip has seen something: $(counts)"
if (exec 3<>/dev/lab_wires) 2>/dev/null; then fail "a second far end"; fi

# SCL rises for each of 36 bits, for the repeated START and for the STOP.
step "register reads at 1 kHz and at 100 kHz: two STARTs, one STOP and 38 rises of SCL each"
for hz in 1000 100000; do
    tool "0x68" get 0x18 0xfe --hz $hz
    counts | tee "$HOME/counts"
    read -r starts stops rises <"$HOME/counts"
    [ "$stops" -gt 0 ] || fail "there was no transfer"
    [ "$starts $rises" = "$((2 * stops)) $((38 * stops))" ] || fail "they differ"
done
tool "^0x18 .*max6615" scan
tool "0x50" set 0x18 0x03 0x50
tool "0x50  80 °C" get 0x18 0x03
tool "nobody answers at this address" get 0x19 0

step "the driver configures and reads it"
"$ADVEE" run driver_aux --set i2c.aux.bus="$bus" --set i2c.aux.hz=2000 >"$log" 2>&1 &
driver=$!
expect "fan1 (0x18 on i2c.aux): MAX6615 revision 1, configured"
"$ADVEE" lcm echo LL_DATA_TEMPERATURE --for 3 >"$HOME/temperatures" || true
grep 'name="box" value=25.0' "$HOME/temperatures" || fail "the temperature is not told: $(cat "$HOME/temperatures")"
tool "is held by driver_aux" dump 0x18

step "too hot"
model hot 1 70
expect "box is at 70.0 °C, above its limit of 60 °C"
model hot 1 25
expect "box is at 25.0 °C, below its limit of 60 °C"

step "the chip loses its supply, and briefly"
model gone
expect "fan1 (0x18 on i2c.aux): nobody answers at this address"
model back
expect "fan1 (0x18 on i2c.aux) answers again"
model reset
expect "had lost its configuration: configured again"

step "SDA is held low"
model sda low
expect "fan1 (0x18 on i2c.aux): a line of the bus is held low, and nine clocks did not free it"
model sda free
expect "fan1 (0x18 on i2c.aux) answers again"

step "SCL is held low"
model scl low
expect "fan1 (0x18 on i2c.aux): a line of the bus is held low, and nine clocks did not free it"
model scl free
expect "fan1 (0x18 on i2c.aux) answers again"

step "end"
kill $driver
wait $driver || fail "exit code $?"
news
