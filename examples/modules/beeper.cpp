// A module in C++ on the official LCM: beeps the faster the nearer the nearest thing is, as a car does that parks.
//
//     lcm-gen -x --cpp-std c++11 --cpp-hpath build messages/*/*.lcm
//     c++ -std=c++11 -O2 -I build -o build/beeper examples/modules/beeper.cpp -llcm
//     build/beeper [NAME]
//
// It does what every module does: announces its state on CM_DATA_STATE each second and on change, obeys CM_CMD_STATE by
// the table of states, reports on CM_EVENT_ERROR what is wrong and that it is well again, and ends at TERMINATE or SIGTERM
// with status 0. Its device are the sonars, LL_DATA_SRFS; while the PAUSE line, LL_EVENT_STOP, holds the robot it is
// silent. beeper.py is the same in Python.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <lcm/lcm-cpp.hpp>
#include <poll.h>
#include <string>
#include "common/cmd_state_t.hpp"
#include "common/data_state_t.hpp"
#include "common/error_t.hpp"
#include "lowlevel/data_srfs_t.hpp"
#include "lowlevel/event_stop_t.hpp"

using Error = common::error_t; // error_t alone is glibc's
using State = common::data_state_t;

namespace {

constexpr double NEAR = 1.0;     // m: things further away are not worth a beep
constexpr double FASTEST = 0.1;  // s between two beeps; otherwise a second a metre
constexpr double SILENT = 1.0;   // s without LL_DATA_SRFS: the sonars are lost
constexpr double ANNOUNCE = 1.0; // s between two announcements
// docs/faults.md; from 0x8000 on each module's own.
constexpr int FORBIDDEN = 0x0001, SONARS_SILENT = 0x8001;

volatile std::sig_atomic_t asked_to_end = 0;

double now()
{
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Wall-clock time in µs that no clock step turns back.
std::int64_t timestamp()
{
    using namespace std::chrono;
    static const auto epoch = system_clock::now().time_since_epoch() - steady_clock::now().time_since_epoch();
    return duration_cast<microseconds>(epoch + steady_clock::now().time_since_epoch()).count();
}

std::string name_of(int state)
{
    switch (state) {
    case State::INIT: return "INIT";
    case State::STOP: return "STOP";
    case State::RUN: return "RUN";
    case State::ERROR: return "ERROR";
    case State::TERMINATE: return "TERMINATE";
    case State::PAUSE: return "PAUSE";
    default: return std::to_string(state);
    }
}

// Whether a command leads from one state to another.
bool obeys(int from, int to, bool manual)
{
    switch (to) {
    case State::TERMINATE: return true;
    case State::STOP: return manual;
    case State::PAUSE: return from == State::RUN || (from == State::STOP && manual);
    case State::RUN: return from == State::PAUSE || (from == State::STOP && manual);
    default: return false;
    }
}

class Beeper {
public:
    explicit Beeper(const std::string &name) : name(name) {}

    int run()
    {
        if (!bus.good() || !bus.subscribe("CM_CMD_STATE", &Beeper::on_command, this) ||
            !bus.subscribe("LL_DATA_SRFS", &Beeper::on_sonars, this) ||
            !bus.subscribe("LL_EVENT_STOP", &Beeper::on_pause_line, this))
            return 0x10; // a resource is not to be had: the bus
        heard = announce_at = beep_at = now();
        while (state != State::TERMINATE) {
            on_time(now());
            pollfd readable = {bus.getFileno(), POLLIN, 0};
            if (poll(&readable, 1, wait_ms()) > 0)
                bus.handle();
            if (asked_to_end)
                enter(State::TERMINATE);
        }
        return 0;
    }

private:
    int wait_ms() const
    {
        double due = announce_at;
        if (wants_to_beep())
            due = std::min(due, beep_at);
        if (!lost)
            due = std::min(due, heard + SILENT);
        return int(std::ceil(std::max(0.0, due - now()) * 1000));
    }

    void on_time(double at)
    {
        if (at >= announce_at)
            announce();
        if (!lost && at >= heard + SILENT) {
            lost = true;
            nearest = INFINITY;
            report(SONARS_SILENT, Error::TIMEOUT, Error::ERROR, "no LL_DATA_SRFS: the sonars are silent", __LINE__);
            fail();
        }
        if (wants_to_beep() && at >= beep_at) {
            std::printf("\abeep %.2f m\n", nearest);
            std::fflush(stdout);
            beep_at = at + std::max(FASTEST, nearest);
        }
    }

    bool wants_to_beep() const { return state == State::RUN && !held && nearest < NEAR; }

    void on_sonars(const lcm::ReceiveBuffer *, const std::string &, const lowlevel::data_srfs_t *message)
    {
        nearest = INFINITY;
        for (const auto &found : message->srfs)
            if (found.valid)
                nearest = std::min(nearest, found.distance);
        heard = now();
        if (lost) {
            lost = false;
            report(SONARS_SILENT, Error::TIMEOUT, Error::NOTICE, "the sonars are heard again", __LINE__);
        }
        if (state == State::INIT)
            enter(State::RUN);
        else if (state == State::ERROR)
            enter(before_error);
    }

    void on_pause_line(const lcm::ReceiveBuffer *, const std::string &, const lowlevel::event_stop_t *message)
    {
        held = message->engaged;
    }

    void on_command(const lcm::ReceiveBuffer *, const std::string &, const common::cmd_state_t *command)
    {
        if ((command->module != name && command->module != "*") || command->state == state)
            return;
        if (!obeys(state, command->state, command->manual)) {
            report(FORBIDDEN, Error::UNKNOWN, Error::WARNING,
                   "command " + name_of(command->state) + " from " + command->source + " refused in " + name_of(state),
                   __LINE__);
            return;
        }
        enter(command->state);
        if (lost)
            fail();
    }

    void fail()
    {
        if (state == State::INIT || state == State::RUN || state == State::PAUSE) {
            before_error = state == State::INIT ? State::RUN : state;
            enter(State::ERROR);
        }
    }

    void enter(int to)
    {
        state = to;
        announce();
    }

    void announce()
    {
        announce_at = now() + ANNOUNCE;
        State message;
        message.timestamp = timestamp();
        message.module = name;
        message.state = std::int8_t(state);
        bus.publish("CM_DATA_STATE", &message);
    }

    void report(int number, int type, int severity, const std::string &text, int line)
    {
        Error message;
        message.timestamp = timestamp();
        message.module = name;
        message.number = number;
        message.message = text;
        message.fatal = false;
        message.type = std::int8_t(type);
        message.severity = std::int8_t(severity);
        message.file = "beeper.cpp";
        message.line = line;
        bus.publish("CM_EVENT_ERROR", &message);
    }

    const std::string name;
    lcm::LCM bus; // LCM_DEFAULT_URL, or LCM's default
    int state = State::INIT;
    int before_error = State::RUN; // where recovery leads
    bool lost = false;             // the sonars, as reported
    bool held = false;             // by the PAUSE line
    double nearest = INFINITY, heard = 0, announce_at = 0, beep_at = 0;
};

} // namespace

int main(int argc, char **argv)
{
    // Without SA_RESTART, so that poll returns.
    struct sigaction end = {};
    end.sa_handler = [](int) { asked_to_end = 1; };
    sigaction(SIGTERM, &end, nullptr);
    sigaction(SIGINT, &end, nullptr);
    return Beeper(argc > 1 ? argv[1] : "beeper").run();
}
