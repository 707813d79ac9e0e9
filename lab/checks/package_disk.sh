#!/bin/sh
# A read-only root, and a full disk: the recorder reports it, and the robot drives.
set -eu
. "$LAB_SOURCE/lab/checks/package.sh"
running
systemctl stop advee

recorder() { "$advee" lcm echo CM_DATA_LOG --for 2.5 | tail -n 1; }
records() { recorder | grep -q 'recording=true'; }

step "the root is read-only"
journalctl --relinquish-var
mount -o remount,ro / || fail "the root cannot be remounted"
trap 'mount -o remount,rw /' EXIT
! touch /opt/advee/log/written 2>/dev/null || fail "the log folder can be written"
systemctl start advee || fail "it does not start"
homed
status
recorder
recorder | grep 'recording=false' || fail "it reports that it records"
journalctl --no-pager -u advee | grep -m 1 -i 'read-only' || fail "the reason is not reported"
drive
systemctl stop advee
mount -o remount,rw /
journalctl --flush

step "the disk of the logs is full"
mount -t tmpfs -o "size=64m,uid=$(id -u advee),gid=$(id -g advee),mode=750" log /opt/advee/log
cat /dev/zero >/opt/advee/log/full 2>/dev/null || true
[ "$(df --output=avail /opt/advee/log | tail -n 1)" -lt 64 ] || fail "it is not full"
systemctl start advee || fail "it does not start"
homed
status
recorder
recorder | grep 'recording=false' || fail "it reports that it records"
drive
systemctl stop advee

step "with free space again it records"
umount /opt/advee/log
systemctl start advee
within 60 all_run || fail "not all modules RUN"
within 20 records || fail "it does not record: $(recorder)"
recorder
systemctl stop advee
