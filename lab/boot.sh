#!/bin/sh
# boot.sh SCRIPT: runs a script as root on an ordinary Debian kernel in QEMU, and ends with its exit status.
#
# The machine's own files are the guest's, by 9p and read-only; what is written there goes to memory and is lost.
# Nothing is installed and no root is needed. LAB_CACHE (default ~/.cache/advee-lab) keeps the kernel, 470 MB.
set -eu

script=$(realpath "$1")
cache=$(realpath -m "${LAB_CACHE:-$HOME/.cache/advee-lab}")
limit=${LAB_LIMIT:-300}
PATH=$PATH:/usr/sbin:/sbin

for tool in qemu-system-x86_64 busybox modprobe depmod; do
    command -v $tool >/dev/null || {
        echo "boot.sh: $tool is missing: apt-get install --no-install-recommends qemu-system-x86 busybox-static kmod" >&2
        exit 125
    }
done

# The kernel, out of its package.
version=$(apt-cache depends linux-image-amd64 | sed -n 's/.*Depends: linux-image-//p' | head -n 1)
[ -n "$version" ] || { echo "boot.sh: apt knows no linux-image-amd64: apt-get update" >&2; exit 125; }
kernel=$cache/$version
if ! [ -d "$kernel" ]; then
    rm -rf "$kernel.new"
    mkdir -p "$kernel.new"
    (cd "$kernel.new" && apt-get -q -o APT::Sandbox::User= download "linux-image-$version" && dpkg-deb -x ./*.deb . && rm ./*.deb)
    depmod -b "$kernel.new" "$version"
    mv "$kernel.new" "$kernel"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/root/bin" "$work/root/modules"
cp "$(command -v busybox)" "$work/root/bin/busybox"
# What it takes to reach our files, in the order of loading.
for module in virtio_pci 9pnet_virtio 9p overlay; do
    modprobe -d "$kernel" -S "$version" --show-depends $module
done | sed -n 's/^insmod //p' | awk '!seen[$1]++ { print $1 }' >"$work/order"
while read -r module; do
    cp "$module" "$work/root/modules/"
    basename "$module"
done <"$work/order" >"$work/root/modules/order"

cat >"$work/root/init" <<END
#!/bin/busybox sh
b=/bin/busybox
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp LAB=1 ADVEE='${ADVEE:-}'
\$b mkdir -p /proc /sys /dev /host /rw /new
\$b mount -t proc proc /proc; \$b mount -t sysfs sys /sys; \$b mount -t devtmpfs dev /dev
for module in \$(\$b cat /modules/order); do \$b insmod /modules/\$module; done
\$b mount -t 9p -o ro,trans=virtio,version=9p2000.L,msize=262144,cache=loose host /host
\$b mount -t tmpfs rw /rw; \$b mkdir /rw/upper /rw/work
\$b mount -t overlay -o lowerdir=/host,upperdir=/rw/upper,workdir=/rw/work root /new
# The machine may have some of them, headers at least.
\$b rm -rf /new/lib/modules/$version; \$b mkdir -p /new/lib/modules; \$b ln -s '$kernel/lib/modules/$version' /new/lib/modules/$version
for d in proc sys dev; do \$b mkdir -p /new/\$d; \$b mount --move /\$d /new/\$d; done
for d in run dev/shm; do \$b mkdir -p /new/\$d; \$b mount -t tmpfs \$d /new/\$d; done
\$b mkdir -p /new/dev/pts; \$b mount -t devpts devpts /new/dev/pts
\$b ip link set lo up
\$b chroot /new /bin/sh '$script'
# isa-debug-exit makes QEMU end with twice this and one: never with what QEMU itself fails with.
\$b printf "\\\\x\$(\$b printf %x \$((\$? + 1)))" | \$b dd of=/new/dev/port bs=1 seek=244 2>/dev/null
\$b poweroff -f
END
chmod +x "$work/root/init"
(cd "$work/root" && find . | busybox cpio -o -H newc 2>/dev/null) >"$work/initrd"

status=0
timeout "$limit" qemu-system-x86_64 -M pc -accel tcg -cpu max -m 768 -nodefaults -no-user-config -no-reboot \
    -display none -kernel "$kernel/boot/vmlinuz-$version" -initrd "$work/initrd" \
    -append "console=ttyS0 panic=-1 quiet mitigations=off" -chardev stdio,id=console -serial chardev:console \
    -device isa-debug-exit,iobase=0xf4,iosize=1 \
    -fsdev local,id=host,path=/,security_model=none,multidevs=remap,readonly=on \
    -device virtio-9p-pci,fsdev=host,mount_tag=host </dev/null || status=$?
case $status in
    124) echo "boot.sh: not done within $limit s" >&2; exit 124 ;;
    [01] | 2 | 12[5-9]) echo "boot.sh: the machine ended by itself" >&2; exit 125 ;;
    *) exit $(((status - 3) / 2)) ;;
esac
