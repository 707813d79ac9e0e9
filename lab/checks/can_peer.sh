#!/bin/sh
# A foreign CANopen slave (durand, PyPI) on the second SJA1000: our master scans, reads and writes it, commands it, and
# assigns its node id.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/can_lib.sh"
needs ip
python=$LAB_SOURCE/.venv/bin/python
"$python" -c "import can, durand" 2>/dev/null || skip "no durand in .venv (tools/venv installs it)"
for interface in can0 can1; do set_up $interface 500000 0; done

slave() { # NODE
    : >"$log" # a fresh one
    "$python" "$LAB_SOURCE/lab/checks/can_peer.py" "$1" >>"$log" 2>&1 &
    slave=$!
    within 60 grep -q ready "$log" || fail "the slave does not start"
}

can() { # COMMAND...: of ours
    "$ADVEE" can "$@" --interface can0
}

says() { # TEXT COMMAND...
    text=$1
    shift
    said=$(can "$@" 2>&1) || true
    echo "$said" | grep -e "$text" || fail "output: $said"
}

same() { # LENGTH [OPTION]: goes there and comes back
    head -c "$1" /dev/urandom >"$HOME/there"
    can sdo download 5 0x2000 "$HOME/there" $2
    can sdo upload 5 0x2000 "$HOME/back" $2
    cmp "$HOME/there" "$HOME/back" || fail "it contains other data"
}

step "scan"
slave 5
says "00004C41  00004231  00010002  0000BEEF .* a slave by durand" scan

step "objects: expedited, in segments, in blocks; refusals"
says "Vendor ID = 0x00004C41" sdo read 5 0x1018:1
for length in 5 888 890 3000; do # no multiple of seven: durand ends such a block with a wrong count of unused bytes
    same $length ""
    same $length --block
done
says "value too high (0x06090031)" sdo write 5 0x2001 21 --type u16
says "object does not exist (0x06020000)" sdo read 5 0x2005 --type u16
says "attempt to write a read-only object (0x06010002)" sdo write 5 0x2002 1 --type u16

step "NMT, confirmed by the heartbeat"
can sdo write 5 0x1017 100
says "operational" nmt start 5
says "stopped" nmt stop 5
says "pre-operational" nmt preop 5
says "has booted" nmt reset 5

step "a node without node id"
kill $slave
wait $slave || true
slave 255
says "00004C41:00004231:00010002:0000BEEF" lss find # not scan: it answers fastscan when it is found already, too
says "node id 9 is set" lss set-node-id 9 --first
says "a slave by durand" sdo read 9 0x1008
kill $slave
wait $slave || true
