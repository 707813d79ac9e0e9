#!/bin/sh
# The installed robot does not run; after its start it reports readiness in words; it runs as its own user, in its
# sandbox.
set -eu
. "$LAB_SOURCE/lab/checks/package.sh"
debs
can_up() { [ "$(cat /sys/class/net/can0/operstate 2>/dev/null)" = up ]; }
no_can() { ! [ -e /sys/class/net/can0 ]; }

step "installed: it does not run until commanded"
install_deb old
is inactive || fail "it was started"
! systemctl --quiet is-enabled advee || fail "it was enabled"
id advee
for group in dialout i2c gpio input; do id -nG advee | grep -qw $group || fail "its user is not in $group"; done
[ "$(id -nG advee-web)" = advee-web ] || fail "the web server's user is in $(id -nG advee-web)"
[ "$(stat -c '%U %a' /opt/advee/log)" = "advee 750" ] || fail "the log folder is $(stat -c '%U %a' /opt/advee/log)"

step "without any hardware it runs nevertheless, and reports what is missing"
systemctl start advee || fail "it does not start"
status
is active || fail "it is not ready"
"$advee" state
journalctl --no-pager -u advee | grep -m 1 'can0' || fail "can0 is not mentioned"
[ "$(ps -o user= -p "$(main)" 2>/dev/null || stat -c %U /proc/"$(main)")" = advee ] || fail "it runs as another user"
systemctl stop advee
is inactive || fail "it does not stop"
[ -z "$(module watchdog)$(module driver_canbus)$(module web)" ] || fail "something is left over"

step "a CAN interface comes up, by itself when its controller appears"
modprobe kvaser_pci
within 20 test -e /sys/class/net/can0 || fail "there is no controller"
! can_up || fail "it is up without a configuration"
cp /usr/share/doc/advee/examples/can0.conf /opt/advee/conf/
systemctl start advee-can@can0 || fail "it does not come up"
ip -details link show can0
ip -details link show can0 | grep -q 'bitrate 500000 ' || fail "its bit rate is wrong"
modprobe -r kvaser_pci
within 20 no_can || fail "it is still there"
modprobe kvaser_pci
within 30 can_up || fail "it does not come up again"

step "the simulated robot: ready, driven, stopped"
running
status
systemctl --no-pager status advee | head -n 20
drive
score=$(systemd-analyze security --no-pager advee.service | tail -n 1)
echo "$score"
systemd-analyze security --no-pager --threshold=25 advee.service >/dev/null || fail "its sandbox is too wide"

step "the web server is another user's, without capabilities, CAN and serial ports, and in shared memory"
user() { stat -c %U "/proc/$(module "$1")"; }
[ "$(user driver_canbus) $(user web)" = "advee advee-web" ] || fail "driver_canbus is $(user driver_canbus)'s, web $(user web)'s"
capabilities() { sed -n "s/^Cap$2:\t//p" "/proc/$(module "$1")/status"; }
for kind in Prm Eff Bnd Amb; do
    [ "$(capabilities web $kind)" = 0000000000000000 ] || fail "web has capabilities: $(capabilities web $kind)"
done
[ "$(capabilities driver_canbus Eff)" = 0000000000001000 ] || fail "driver_canbus has $(capabilities driver_canbus Eff)"
shared=$(find /dev/shm -maxdepth 1 -name 'lcm*' -user advee -perm 1770)
[ -d "$shared" ] || fail "the bus is not shared: $(ls -l /dev/shm)"
find "$shared" -name '*.station' -user advee-web | grep -q . || fail "web is not in shared memory"
before=$(module web)
kill -STOP "$before"
within 30 other web "$before" || fail "it hangs, and is not replaced"
within 30 all_run || fail "not all modules RUN"
score=$(systemd-analyze security --no-pager advee-web.service | tail -n 1)
echo "$score"
systemd-analyze security --no-pager --threshold=20 advee-web.service >/dev/null || fail "its sandbox is too wide"
systemctl stop advee
is inactive || fail "it does not stop"
[ "$(systemctl show -P ActiveState advee-web)" = inactive ] || fail "the web server's unit does not stop with it"
[ "$(show Result)" = success ] || fail "it ended with $(show Result)"
ls -la /run/advee /run/advee-web 2>/dev/null && fail "a run folder is left over"
journalctl --no-pager -u advee -u advee-web | grep -iE 'denied|not permitted|read-only' && fail "something is not permitted"

step "processor and memory settings of modules.toml are permitted"
sed -i '/^name = "driver_canbus"/a rt_priority = 20' /opt/advee/conf/modules.toml
sed -i '/^name = "logger"/a nice = -5' /opt/advee/conf/modules.toml
systemctl start advee || fail "it does not start"
chrt -p "$(module driver_canbus)"
chrt -p "$(module driver_canbus)" | grep -q 'priority: 20' || fail "driver_canbus has no real-time priority"
chrt -p "$(module watchdog)" | grep -q 'priority: 21' || fail "the watchdog is not above it"
grep VmLck "/proc/$(module driver_canbus)/status"
[ "$(sed -n 's/^VmLck:[^0-9]*\([0-9]*\) kB/\1/p' "/proc/$(module driver_canbus)/status")" -gt 1000 ] || fail "its memory is not locked"
[ "$(cut -d' ' -f19 "/proc/$(module logger)/stat")" = -5 ] || fail "the logger's nice value is not set"
systemctl stop advee
sed -i '/^rt_priority = 20/d; /^nice = -5/d' /opt/advee/conf/modules.toml

step "a refused configuration is not retried"
sed -i 's/^wheelbase_m = .*/wheelbase_m = -1/' /opt/advee/conf/robot.toml
systemctl start advee && fail "it starts"
is failed || fail "it is $(show ActiveState)"
[ "$(restarts)" = 0 ] || fail "it was tried again $(restarts) times"
journalctl --no-pager -n 5 -u advee | grep -m 1 'wheelbase_m' || fail "the reason is not reported"
sed -i 's/^wheelbase_m = .*/wheelbase_m = 0.60/' /opt/advee/conf/robot.toml
