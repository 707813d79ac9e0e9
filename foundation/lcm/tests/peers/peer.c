/* A peer on the official C library, and the reference for peer.cpp and peer.py, which do the same.
 *
 *   peer bus TYPE...  joins LCM_DEFAULT_URL, prints "ready" once it is subscribed; then
 *                       publishes what comes on stdin,
 *                       writes what it receives on TO_.* to stdout,
 *                       decodes what it receives on a type's name with the code of lcm-gen, encodes it anew, writes
 *                       that to stdout and publishes it on FROM_TYPED;
 *                     each as length of channel, length of payload (32 bits each, big-endian), channel, payload.
 *                     Ends with its stdin.
 *   peer log IN OUT   copies an event log, event by event.
 *
 * In C and C++ the types are those of types.h, types.hpp, which the test writes: it includes the generated headers and
 * lists the types in EACH_TYPE(T). */
#include <lcm/lcm.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "types.h"

static void fail(const char *what)
{
    fprintf(stderr, "peer.c: %s\n", what);
    exit(1);
}

static void put(FILE *out, uint32_t n)
{
    for (int shift = 24; shift >= 0; shift -= 8)
        putc((n >> shift) & 255, out);
}

static uint32_t get(FILE *in)
{
    uint32_t n = 0;
    for (int i = 0; i < 4; i++)
        n = n << 8 | (getc(in) & 255);
    return n;
}

static void tell(const char *channel, const void *payload, uint32_t len)
{
    put(stdout, strlen(channel));
    put(stdout, len);
    fputs(channel, stdout);
    fwrite(payload, 1, len, stdout);
    fflush(stdout);
}

static void on_raw(const lcm_recv_buf_t *buf, const char *channel, void *user)
{
    (void) user;
    tell(channel, buf->data, buf->data_size);
}

static lcm_t *lcm;

#define HANDLER(name)                                                                                   \
    static void on_##name(const lcm_recv_buf_t *buf, const char *channel, const name *msg, void *user)  \
    {                                                                                                   \
        int size = name##_encoded_size(msg);                                                            \
        uint8_t *bytes = malloc(size);                                                                  \
        (void) buf, (void) user;                                                                        \
        if (name##_encode(bytes, 0, size, msg) != size)                                                 \
            fail("cannot encode " #name);                                                               \
        tell(channel, bytes, size);                                                                     \
        free(bytes);                                                                                    \
        name##_publish(lcm, "FROM_TYPED", msg);                                                         \
    }
EACH_TYPE(HANDLER)

#define SUBSCRIBE(name) name##_subscription_set_queue_capacity(name##_subscribe(lcm, #name, on_##name, NULL), 0);

/* Publishes the next message of stdin; 0 at its end. */
static int publish(void)
{
    int first = getc(stdin);
    if (first == EOF)
        return 0;
    ungetc(first, stdin);
    uint32_t channel_len = get(stdin), len = get(stdin);
    char channel[256] = "";
    void *payload = malloc(len ? len : 1);
    if (channel_len >= sizeof channel || fread(channel, 1, channel_len, stdin) != channel_len ||
        fread(payload, 1, len, stdin) != len)
        fail("stdin is cut short");
    if (lcm_publish(lcm, channel, payload, len) != 0)
        fail("cannot publish");
    free(payload);
    return 1;
}

static int copy_log(const char *from, const char *to)
{
    lcm_eventlog_t *in = lcm_eventlog_create(from, "r"), *out = lcm_eventlog_create(to, "w");
    lcm_eventlog_event_t *event;
    if (!in || !out)
        fail("cannot open a log");
    while ((event = lcm_eventlog_read_next_event(in))) {
        if (lcm_eventlog_write_event(out, event) != 0)
            fail("cannot write an event");
        lcm_eventlog_free_event(event);
    }
    lcm_eventlog_destroy(in);
    lcm_eventlog_destroy(out);
    return 0;
}

int main(int argc, char **argv)
{
    if (argc == 4 && !strcmp(argv[1], "log"))
        return copy_log(argv[2], argv[3]);
    if (argc < 2 || strcmp(argv[1], "bus"))
        fail("usage: peer bus | peer log IN OUT");
    if (!(lcm = lcm_create(NULL)))
        fail("no LCM");
    lcm_subscription_t *raw = lcm_subscribe(lcm, "TO_.*", on_raw, NULL);
    if (!raw)
        fail("cannot subscribe");
    lcm_subscription_set_queue_capacity(raw, 0);
    EACH_TYPE(SUBSCRIBE)
    setvbuf(stdin, NULL, _IONBF, 0); /* so that poll sees what there is to read */
    puts("ready");
    fflush(stdout);
    struct pollfd fds[] = {{.fd = lcm_get_fileno(lcm), .events = POLLIN}, {.fd = 0, .events = POLLIN}};
    for (;;) {
        if (poll(fds, 2, -1) < 0)
            fail("cannot poll");
        if (fds[0].revents && lcm_handle(lcm) != 0)
            fail("cannot receive");
        if (fds[1].revents && !publish())
            break;
    }
    lcm_destroy(lcm);
    return 0;
}
