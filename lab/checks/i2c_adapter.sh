# Functions shared by the checks on models/i2c_usb.py: the model runs, its adapter is plugged in and has the name
# $adapter.

model() { # LINE: the model does it
    : >"$HOME/obeyed"
    echo "$*" >"$HOME/model"
    within 10 grep -q -x -e "$*" "$HOME/obeyed" || fail "the model did not: $*"
}

find_adapter() {
    found=$(grep -l i2c-tiny-usb /sys/class/i2c-dev/*/name 2>/dev/null) || return 1
    adapter=/dev/$(basename "$(dirname "$found")")
}

no_adapter() { ! find_adapter; }

told() { # PATTERN [SECONDS]: the temperatures that are told have it, by then
    "$ADVEE" lcm echo LL_DATA_TEMPERATURE --for "${2:-3}" >"$HOME/temperatures" || true
    grep -q -E -e "$1" "$HOME/temperatures" || {
        cat "$HOME/temperatures"
        fail "not in LL_DATA_TEMPERATURE: $1"
    }
}

needs python3
mkfifo "$HOME/model"
# Opened for appending, so that it can be truncated meanwhile.
touch "$HOME/obeyed"
python3 lab/models/i2c_usb.py "$HOME/model" "$HOME/obeyed" &
model plug
within 10 find_adapter || fail "the kernel found no adapter"
echo "the adapter is $adapter"
