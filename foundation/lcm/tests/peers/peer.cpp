// A peer on the official C++ interface; what it does stands in peer.c.
#include <lcm/lcm-cpp.hpp>
#include <poll.h>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>
#include "types.hpp"

static void fail(const char *what)
{
    std::fprintf(stderr, "peer.cpp: %s\n", what);
    std::exit(1);
}

static bool read(void *to, std::size_t len)
{
    return std::fread(to, 1, len, stdin) == len;
}

static std::uint32_t number(const unsigned char *b)
{
    return std::uint32_t(b[0]) << 24 | std::uint32_t(b[1]) << 16 | std::uint32_t(b[2]) << 8 | b[3];
}

static void tell(const std::string &channel, const void *payload, std::uint32_t len)
{
    for (std::uint32_t n : {std::uint32_t(channel.size()), len})
        for (int shift = 24; shift >= 0; shift -= 8)
            std::putchar((n >> shift) & 255);
    std::fwrite(channel.data(), 1, channel.size(), stdout);
    std::fwrite(payload, 1, len, stdout);
    std::fflush(stdout);
}

struct Handler {
    lcm::LCM lcm;

    void raw(const lcm::ReceiveBuffer *buf, const std::string &channel)
    {
        tell(channel, buf->data, buf->data_size);
    }

    template <class T>
    void typed(const lcm::ReceiveBuffer *, const std::string &channel, const T *msg)
    {
        std::vector<char> bytes(msg->getEncodedSize());
        if (msg->encode(bytes.data(), 0, int(bytes.size())) != int(bytes.size()))
            fail("cannot encode");
        tell(channel, bytes.data(), std::uint32_t(bytes.size()));
        lcm.publish("FROM_TYPED", msg);
    }

    bool publish()
    {
        unsigned char lengths[8];
        if (!read(lengths, 8))
            return false;
        std::string channel(number(lengths), 0);
        std::vector<char> payload(number(lengths + 4));
        if (!read(&channel[0], channel.size()) || !read(payload.data(), payload.size()))
            fail("stdin is cut short");
        if (lcm.publish(channel, payload.data(), unsigned(payload.size())) != 0)
            fail("cannot publish");
        return true;
    }
};

#define SUBSCRIBE(type, channel) handler.lcm.subscribe(channel, &Handler::typed<type>, &handler)->setQueueCapacity(0);

static int copy_log(const char *from, const char *to)
{
    lcm::LogFile in(from, "r"), out(to, "w");
    if (!in.good() || !out.good())
        fail("cannot open a log");
    while (const lcm::LogEvent *event = in.readNextEvent()) {
        lcm::LogEvent copy = *event;
        if (out.writeEvent(&copy) != 0)
            fail("cannot write an event");
    }
    return 0;
}

int main(int argc, char **argv)
{
    std::string role = argc > 1 ? argv[1] : "";
    if (role == "log" && argc == 4)
        return copy_log(argv[2], argv[3]);
    if (role != "bus")
        fail("usage: peer bus | peer log IN OUT");
    Handler handler;
    if (!handler.lcm.good())
        fail("no LCM");
    handler.lcm.subscribe("TO_.*", &Handler::raw, &handler)->setQueueCapacity(0);
    EACH_TYPE(SUBSCRIBE)
    std::setvbuf(stdin, nullptr, _IONBF, 0);
    std::puts("ready");
    std::fflush(stdout);
    pollfd fds[] = {{handler.lcm.getFileno(), POLLIN, 0}, {0, POLLIN, 0}};
    for (;;) {
        if (poll(fds, 2, -1) < 0)
            fail("cannot poll");
        if (fds[0].revents && handler.lcm.handle() != 0)
            fail("cannot receive");
        if (fds[1].revents && !handler.publish())
            return 0;
    }
}
