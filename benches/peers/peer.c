// A peer of the bench `benches/lcm.rs` in C: plain multicast sockets (`raw`), or the official LCM library (`official`).
//
//   peer raw|official PORT RECV_BUF echo|ping|send|count|idle ARGUMENTS
//
// Roles, arguments and lines are those of `benches/lcm/peer.rs`; how the two talk stands there.
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <lcm/lcm.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define GROUP "239.255.76.67"
#define PIECE_MAX 65000  // raw: a longer message goes in pieces of this size
#define END UINT64_MAX   // number of the message after the last

struct head { uint64_t number, size; };  // at the beginning of every message
struct kind { const char *channel; size_t size; };

static void die(const char *what) { perror(what); exit(1); }

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

// ---- what one message is: all the same, or Talos's mix (see `peer.rs`)
static size_t one_size;  // 0: the mix

static struct kind kind(uint64_t number) {
    if (one_size) return (struct kind){"PING", one_size};
    if (number % 80 == 0) return (struct kind){"IMAGE", 104288};
    switch (number % 5) {
    case 0: case 2: return (struct kind){"POSE", 128};
    case 1: case 3: return (struct kind){"LASER", 1206};
    default: return (struct kind){"SCAN", 3072};
    }
}

// ---- transports: publish, and wait for at least one message
static uint8_t out[1 << 17];
static void (*on_message)(const uint8_t *, size_t);
static int raw, buffer, rx = -1, tx;
static struct sockaddr_in to;
static lcm_t *lcm;

static void want_buffer(int fd) {
    if (setsockopt(fd, SOL_SOCKET, SO_RCVBUFFORCE, &buffer, sizeof buffer))
        setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer);
}

static struct sockaddr_in address(int port) {
    struct sockaddr_in a = {.sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = inet_addr(GROUP)};
    return a;
}

static void raw_open(int port_in, int port_out) {
    unsigned char zero = 0, one = 1;
    int yes = 1;
    if ((tx = socket(AF_INET, SOCK_DGRAM, 0)) < 0) die("socket");
    if (setsockopt(tx, IPPROTO_IP, IP_MULTICAST_TTL, &zero, 1) || setsockopt(tx, IPPROTO_IP, IP_MULTICAST_LOOP, &one, 1)) die("multicast");
    to = address(port_out);
    if (!port_in) return;
    struct sockaddr_in at = address(port_in);
    struct ip_mreq join = {.imr_multiaddr = at.sin_addr};
    if ((rx = socket(AF_INET, SOCK_DGRAM, 0)) < 0) die("socket");
    setsockopt(rx, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    want_buffer(rx);
    if (bind(rx, (struct sockaddr *) &at, sizeof at)) die("bind");
    if (setsockopt(rx, IPPROTO_IP, IP_ADD_MEMBERSHIP, &join, sizeof join)) die("join");
}

static void raw_receive(void) {
    static uint8_t in[1 << 17];
    static size_t have;  // bytes of a message in pieces
    struct head head;
    ssize_t n = recv(rx, in + have, sizeof in - have, 0);
    if (n < 0) die("recv");
    if (have && n == PIECE_MAX) memmove(in, in + have, n), have = 0;  // the rest of the previous message is lost
    have += n;
    memcpy(&head, in, sizeof head);
    if (have >= sizeof head && have < head.size && n == PIECE_MAX) return;
    if (have >= sizeof head && have == head.size) on_message(in, have);
    have = 0;
}

static void official_on(const lcm_recv_buf_t *message, const char *channel, void *user) {
    (void) channel, (void) user;
    if (message->data_size >= sizeof(struct head)) on_message(message->data, message->data_size);  // else: its self test
}

static void official_open(int port, const char *pattern) {
    char url[96];
    snprintf(url, sizeof url, "udpm://" GROUP ":%d?ttl=0&recv_buf_size=%d", port, buffer);
    if (!(lcm = lcm_create(url))) die("lcm_create");
    if (!pattern) return;
    lcm_subscription_t *subscription = lcm_subscribe(lcm, pattern, official_on, NULL);
    if (!subscription) die("lcm_subscribe");
    lcm_subscription_set_queue_capacity(subscription, 0);  // no limit: only the socket may lose
    // The library requests no more than net.core.rmem_max; if permitted, set the same size as for ours.
    for (int fd = 3; fd < 64; fd++) {
        int type = 0;
        struct sockaddr_in at = {0};
        socklen_t size = sizeof type, length = sizeof at;
        if (!getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) && type == SOCK_DGRAM &&
            !getsockname(fd, (struct sockaddr *) &at, &length) && at.sin_port == htons(port))
            want_buffer(fd), rx = fd;
    }
}

// `in`, `port_in`: channel to receive, for raw sockets the port; NULL, 0: publishes only.
static void open_bus(int port, const char *in, int port_in, int port_out) {
    if (raw) raw_open(port_in, port_out);
    else official_open(port, in);
}

static void publish(const char *channel, uint64_t number, size_t size) {
    struct head head = {number, size};
    memcpy(out, &head, sizeof head);
    if (!raw) {
        if (lcm_publish(lcm, channel, out, size)) die("lcm_publish");
        return;
    }
    for (size_t at = 0; at < size; at += PIECE_MAX) {
        size_t n = size - at < PIECE_MAX ? size - at : PIECE_MAX;
        if (sendto(tx, out + at, n, 0, (struct sockaddr *) &to, sizeof to) != (ssize_t) n) die("sendto");
    }
}

static void receive(void) {
    if (raw) raw_receive();
    else if (lcm_handle(lcm)) die("lcm_handle");
}

// ---- roles
static uint64_t heard;  // number of the last message
static struct { uint64_t received, bytes, wrong; int64_t first, last; int ended; } counted;

static void hear(const uint8_t *message, size_t size) {
    struct head head;
    (void) size;
    memcpy(&head, message, sizeof head);
    heard = head.number;
}

static void answer(const uint8_t *message, size_t size) {
    hear(message, size);
    publish("PONG", heard, size);
}

static void count(const uint8_t *message, size_t size) {
    struct head head;
    memcpy(&head, message, sizeof head);
    if (head.number == END) { counted.ended = 1; return; }
    // Complete, of the right size, and in order.
    if (head.size != size || size != kind(head.number).size || (counted.received && head.number <= heard)) { counted.wrong++; return; }
    heard = head.number;
    counted.last = now_ns();
    if (!counted.received++) counted.first = counted.last;
    counted.bytes += size;
}

static void ready(void) {
    int granted = 0;
    socklen_t size = sizeof granted;
    if (rx >= 0) getsockopt(rx, SOL_SOCKET, SO_RCVBUF, &granted, &size);
    printf("ready %d\n", granted / 2);  // the kernel reports twice what it grants, socket(7)
    fflush(stdout);
}

static void line(void) {
    char text[16];
    if (!fgets(text, sizeof text, stdin)) exit(0);
}

static int by_value(const void *a, const void *b) {
    int64_t x = *(const int64_t *) a, y = *(const int64_t *) b;
    return (x > y) - (x < y);
}

static void ping(size_t size, long trips) {
    long warm = trips / 8;
    int64_t *took = malloc(trips * sizeof *took);
    if (!took) die("malloc");
    on_message = hear;
    ready(), line();
    for (long i = -warm; i < trips; i++) {
        uint64_t number = i + warm + 1;
        int64_t begin = now_ns();
        publish("PING", number, size);
        while (heard != number) receive();
        if (i >= 0) took[i] = now_ns() - begin;
    }
    qsort(took, trips, sizeof *took, by_value);
    printf("trips %ld p50 %lld p99 %lld\n", trips + warm, (long long) took[trips / 2], (long long) took[trips * 99 / 100]);
}

static void send_all(long rate, long ms) {
    uint64_t sent = 0, due;
    int64_t begin = now_ns(), end = begin + ms * 1000000LL, now;
    ready(), line();
    begin = now_ns(), end = begin + ms * 1000000LL;
    while ((now = now_ns()) < end) {
        if (rate) {  // messages due by the next full millisecond, at once
            int64_t tick = (now - begin) / 1000000 + 1;
            struct timespec t = {(begin + tick * 1000000) / 1000000000, (begin + tick * 1000000) % 1000000000};
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
            due = (uint64_t) rate * tick / 1000;
        } else
            due = sent + 1;
        for (; sent < due; sent++) publish(kind(sent).channel, sent, kind(sent).size);
    }
    printf("sent %llu span %lld\n", (unsigned long long) sent, (long long) (now_ns() - begin));
    fflush(stdout);
    line();  // all have had time to receive; now the end, until the process is killed
    for (;;) publish(kind(1).channel, END, sizeof(struct head)), usleep(10000);
}

int main(int argc, char **argv) {
    if (argc < 6) return 1;
    int port = atoi(argv[2]);
    const char *role = argv[4];
    long first = atol(argv[5]), second = argc > 6 ? atol(argv[6]) : 0;
    raw = !strcmp(argv[1], "raw"), buffer = atoi(argv[3]);
    if (!strcmp(role, "ping")) {
        open_bus(port, "PONG", port + 1, port);
        ping(first, second);
    } else if (!strcmp(role, "echo")) {
        open_bus(port, "PING", port, port + 1);
        on_message = answer;
        ready();
        for (;;) receive();
    } else if (!strcmp(role, "send")) {
        one_size = argc > 7 ? atol(argv[7]) : 0;
        open_bus(port, NULL, 0, port);
        send_all(first, second);
    } else if (!strcmp(role, "count")) {
        one_size = first;
        open_bus(port, one_size ? "PING" : ".*", port, port);
        on_message = count;
        ready();
        while (!counted.ended) receive();
        printf("received %llu wrong %llu bytes %llu span %lld\n", (unsigned long long) counted.received,
               (unsigned long long) counted.wrong, (unsigned long long) counted.bytes, (long long) (counted.last - counted.first));
    } else if (!strcmp(role, "idle")) {
        open_bus(port, "OTHER", port, port);
        on_message = hear;
        ready();
        for (;;) receive();
    } else
        return 1;
    fflush(stdout);
    line();  // stay, so that its CPU time can be read
    return 0;
}
