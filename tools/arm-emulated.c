/* Calls that Debian 12's qemu-user does not forward to the kernel, for programs tested under it (tools/arm ARCH run).
 *
 * SO_TIMESTAMPNS   by SO_TIMESTAMP, which it knows: the kernel's own receive time, in whole microseconds.
 * SO_RXQ_OVFL      the kernel's count of dropped datagrams is not available: it is zero.
 * SO_DETACH_FILTER by another filter, which accepts everything.
 * IP_MULTICAST_IF  not set: multicast uses the route, as required by programs without an interface in their URL.
 * TCGETS2, TCSETS2  by TCGETS and TCSETS: a speed is stored, not set. Enough for a pseudo-terminal.
 * readdir          by readdir64: offsets in a folder from a 64-bit kernel do not fit 32 bits.
 *
 * All other calls are passed on. Not part of the delivered program.
 */
#define _GNU_SOURCE
#include <asm/termbits.h>
#include <dirent.h>
#include <dlfcn.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>

#ifndef SO_TIMESTAMPNS
#define SO_TIMESTAMPNS 35
#endif

int setsockopt(int fd, int level, int name, const void *value, socklen_t length)
{
    static int (*next)(int, int, int, const void *, socklen_t);
    if (!next)
        next = dlsym(RTLD_NEXT, "setsockopt");
    if (level == SOL_SOCKET && name == SO_TIMESTAMPNS)
        name = SO_TIMESTAMP;
    if ((level == SOL_SOCKET && name == SO_RXQ_OVFL) || (level == IPPROTO_IP && name == IP_MULTICAST_IF))
        return 0;
    if (level == SOL_SOCKET && name == SO_DETACH_FILTER) {
        struct sock_filter all = BPF_STMT(BPF_RET | BPF_K, 0xffffffff);
        struct sock_fprog program = {1, &all};
        return next(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program);
    }
    return next(fd, level, name, value, length);
}

ssize_t recvmsg(int fd, struct msghdr *message, int flags)
{
    static ssize_t (*next)(int, struct msghdr *, int);
    if (!next)
        next = dlsym(RTLD_NEXT, "recvmsg");
    ssize_t received = next(fd, message, flags);
    if (received < 0)
        return received;
    for (struct cmsghdr *one = CMSG_FIRSTHDR(message); one; one = CMSG_NXTHDR(message, one)) {
        if (one->cmsg_level != SOL_SOCKET || one->cmsg_type != SO_TIMESTAMP)
            continue;
        struct timeval micros;
        memcpy(&micros, CMSG_DATA(one), sizeof micros);
        struct timespec nanos = {micros.tv_sec, micros.tv_usec * 1000};
        memcpy(CMSG_DATA(one), &nanos, sizeof nanos);
        one->cmsg_type = SO_TIMESTAMPNS;
    }
    return received;
}

#if __SIZEOF_LONG__ == 4
struct dirent *readdir(DIR *folder)
{
    static __thread struct dirent entry;
    const struct dirent64 *found = readdir64(folder);
    if (!found)
        return 0;
    entry.d_ino = found->d_ino;
    entry.d_reclen = sizeof entry;
    entry.d_type = found->d_type;
    strcpy(entry.d_name, found->d_name);
    return &entry;
}
#endif

int ioctl(int fd, unsigned long request, ...)
{
    static int (*next)(int, unsigned long, ...);
    static struct speed { tcflag_t bits; speed_t in, out; } speeds[1024];
    if (!next)
        next = dlsym(RTLD_NEXT, "ioctl");
    va_list rest;
    va_start(rest, request);
    void *argument = va_arg(rest, void *);
    va_end(rest);
    unsigned long plain = request == TCGETS2 ? TCGETS : request == TCSETS2 ? TCSETS : request == TCSETSW2 ? TCSETSW : 0;
    if (!plain || fd < 0 || fd >= 1024)
        return next(fd, request, argument);
    struct termios2 *told = argument;
    struct speed *speed = &speeds[fd];
    struct termios asked; /* the first members of both are the same */
    memcpy(&asked, told, sizeof asked);
    asked.c_cflag = (asked.c_cflag & ~CBAUD) | B38400;
    int result = next(fd, plain, &asked);
    if (result < 0)
        return result;
    if (request == TCGETS2) {
        memcpy(told, &asked, sizeof asked);
        told->c_cflag = (told->c_cflag & ~CBAUD) | (speed->out ? speed->bits : B38400);
        told->c_ispeed = speed->out ? speed->in : 38400;
        told->c_ospeed = speed->out ? speed->out : 38400;
    } else {
        *speed = (struct speed){told->c_cflag & CBAUD, told->c_ispeed, told->c_ospeed};
    }
    return 0;
}
