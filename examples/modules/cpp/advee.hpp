// The contract of a module, for modules in C++17 on the official LCM (docs/writing-a-module.md).
//
//     class Watch : public advee::Module {
//     public:
//         explicit Watch(const advee::Options &options) : Module(options)
//         {
//             subscribe<lowlevel::data_srfs_t>("LL_DATA_SRFS", [this](const auto &sonars) { working(); });
//         }
//     };
//     int main(int argc, char **argv) { return advee::run<Watch>(advee::Options("watch", argc, argv)); }
//
// One loop serves the bus, timers and the module's own descriptors, and sends heartbeats; all handlers are called from
// it and must return quickly: one that takes 200 ms is a hang. Around them the loop announces the state each second and
// on change, obeys state commands by the table, reports each fault when it is raised and when it is cleared, lists the
// active ones, and ends at TERMINATE, at SIGTERM, and when the watchdog that started it is gone without a successor.
// Needs the output of the official lcm-gen for messages/*.lcm, and liblcm 1.3.1 or later. advee.py: the same in Python.
#pragma once

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fcntl.h>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <memory>
#include <mutex>
#include <poll.h>
#include <string>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>
#include <vector>
#include "common/cmd_level_t.hpp"
#include "common/cmd_state_t.hpp"
#include "common/data_faults_t.hpp"
#include "common/data_state_t.hpp"
#include "common/error_t.hpp"

namespace advee {

constexpr double ANNOUNCE = 1.0; // s between two announcements
constexpr double BEAT = 0.05;    // s between two heartbeats
constexpr double LOOK = 0.5;     // s between two checks for the watchdog
constexpr int ORPHANED = 6;      // checks without CM_DATA_PROCESSES: the watchdog is gone, without a successor
constexpr std::size_t FAULTS_MAX = 256; // active faults in a list; further ones are not reported
constexpr std::size_t TEXT_MAX = 512;   // bytes of a subject or a message in a list
constexpr int BURST = 64;        // maximum messages per cycle of the loop, so that a flood delays nothing else for long
constexpr int LEVEL_DEBUG = 0, LEVEL_ERROR = 3; // lowest and highest; a severity is of the level above its value
constexpr double REFUSALS = 1.0; // s at least between two reports of refused commands for the levels

// Exit codes: a class plus a number 0 to 16.
enum Exit : int { RESOURCE = 0x10, DEVICE = 0x20, OTHER = 0x40 };
// Fault numbers shared by all modules (docs/faults.md). A module's own numbers begin at 0x8001.
constexpr int COMMAND_FORBIDDEN = 0x0001, MESSAGE_MALFORMED = 0x0002, UNHANDLED = 0x8000;

// The states of a module, types and severities of faults, by their values on the wire.
enum class State : std::int8_t { Unknown, Init, Stop, Run, Error, Terminate, Pause };
enum class Kind : std::int8_t { Unknown, Timeout, Resource, Device };
enum class Severity : std::int8_t { Notice, Warning, Error };

inline const char *name_of(State state)
{
    static const char *const names[] = {"UNKNOWN", "INIT", "STOP", "RUN", "ERROR", "TERMINATE", "PAUSE"};
    return names[int(state)];
}

// Monotonic time, s: for deadlines.
inline double now()
{
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Current time for messages, µs since 1970; a step of the wall clock never turns it back.
inline std::int64_t timestamp()
{
    using namespace std::chrono;
    static const auto epoch = system_clock::now().time_since_epoch() - steady_clock::now().time_since_epoch();
    return duration_cast<microseconds>(epoch + steady_clock::now().time_since_epoch()).count();
}

// The command line of a module: --name, --state (RUN, PAUSE or STOP: the one after INIT) and --lcm-url; other arguments
// are kept in `rest`. The watchdog passes the same by the environment variables ADVEE_MODULE, ADVEE_STATE and
// LCM_DEFAULT_URL; arguments have priority. An invalid command line ends the process.
struct Options {
    std::string name, lcm_url;
    State state = State::Run;
    std::vector<std::string> rest;

    Options(const std::string &module, int argc, char **argv)
        : name(variable("ADVEE_MODULE", module)),
          lcm_url(variable("LCM_DEFAULT_URL", "udpm://239.255.76.67:7667?ttl=0"))
    {
        std::string first = variable("ADVEE_STATE", "RUN");
        const std::map<std::string, std::string *> known = {
            {"--name", &name}, {"--state", &first}, {"--lcm-url", &lcm_url}};
        for (int n = 1; n < argc; ++n) {
            const auto option = known.find(argv[n]);
            if (option == known.end())
                rest.emplace_back(argv[n]);
            else if (++n < argc)
                *option->second = argv[n];
            else
                refuse(option->first + " needs a value");
        }
        if (first != "RUN" && first != "PAUSE" && first != "STOP")
            refuse("--state " + first + ": expected RUN, PAUSE or STOP");
        state = first == "RUN" ? State::Run : first == "PAUSE" ? State::Pause : State::Stop;
    }

    // Prints the reason and exits with RESOURCE: the command line is invalid.
    [[noreturn]] void refuse(const std::string &why) const
    {
        std::fprintf(stderr, "%s: %s\n", name.c_str(), why.c_str());
        std::exit(RESOURCE);
    }

private:
    static std::string variable(const char *key, const std::string &otherwise)
    {
        const char *value = std::getenv(key);
        return value && *value ? value : otherwise;
    }
};

// The heartbeat of one thread.
class Beat {
public:
    Beat() = default;
    Beat(int page, off_t place) : page(page), place(place), due(now() + BEAT) {}

    // To be called in the thread's loop at least each 50 ms; does not block.
    void operator()()
    {
        if (page < 0 || now() < due)
            return;
        due = now() + BEAT;
        ++count;
        const std::uint8_t bytes[] = {std::uint8_t(count), std::uint8_t(count >> 8), std::uint8_t(count >> 16),
                                      std::uint8_t(count >> 24)};
        // A failed write is a missing heartbeat, which the watchdog detects.
        (void)!pwrite(page, bytes, sizeof bytes, place);
    }

private:
    int page = -1;
    off_t place = 0;
    double due = 0;
    std::uint32_t count = 1;
};

// The heartbeat page of this process (docs/beats.md). Without a page, when started by hand, it has no effect.
class Beats {
public:
    Beats()
    {
        const char *path = std::getenv("ADVEE_BEATS");
        if (path && *path && (page = open(path, O_WRONLY | O_NOFOLLOW | O_CLOEXEC)) < 0)
            std::fprintf(stderr, "no page of beats: %s: %s\n", path, std::strerror(errno));
    }
    Beats(const Beats &) = delete;
    Beats &operator=(const Beats &) = delete;
    ~Beats()
    {
        if (page >= 0)
            close(page);
    }

    // Returns the heartbeat of the thread of that name, for use by that thread only. From this call on silence is a
    // hang, so make it when the loop begins. Maximum number of threads: 63.
    Beat thread(const std::string &name)
    {
        const std::lock_guard<std::mutex> lock(mutex);
        if (page < 0 || threads == 63)
            return Beat();
        const off_t place = 64 + 64 * threads++;
        std::array<char, 64> entry{};
        name.copy(entry.data(), 48);
        entry[48] = 1;
        std::array<char, 16> head{'B', 'E', 'A', 'T', 1};
        const std::uint32_t pid = std::uint32_t(getpid());
        for (int n = 0; n < 4; ++n)
            head[8 + n] = char(pid >> 8 * n);
        head[12] = char(threads);
        // The number of threads last: an entry counts when it is complete.
        if (pwrite(page, entry.data(), entry.size(), place) < 0 || pwrite(page, head.data(), head.size(), 0) < 0)
            std::perror("page of beats");
        return Beat(page, place + 48);
    }

    explicit operator bool() const { return page >= 0; }

private:
    int page = -1, threads = 0;
    std::mutex mutex;
};

// SIGTERM and SIGINT as a descriptor. Created before any thread is started, as LCM does: all threads inherit the mask.
class Signals {
public:
    Signals()
    {
        sigset_t asked;
        sigemptyset(&asked);
        sigaddset(&asked, SIGTERM);
        sigaddset(&asked, SIGINT);
        pthread_sigmask(SIG_BLOCK, &asked, nullptr);
        fd = signalfd(-1, &asked, SFD_CLOEXEC | SFD_NONBLOCK);
    }
    Signals(const Signals &) = delete;
    Signals &operator=(const Signals &) = delete;
    ~Signals() { close(fd); }

    int fd;
};

// A module: derive from it, subscribe in the constructor, call working() when the device is there.
class Module {
public:
    explicit Module(const Options &options) : name(options.name), bus(options.lcm_url), wanted(options.state)
    {
        if (!bus.good())
            options.refuse("LCM at " + options.lcm_url + " cannot be had");
        subscribe<common::cmd_state_t>("CM_CMD_STATE", [this](const auto &command) { obey(command); });
        subscribe<common::cmd_level_t>("CM_CMD_LEVEL", [this](const auto &command) { set_level(command); });
        watch(bus.getFileno(), [this] { on_bus(); });
        watch(signals.fd, [this] { end(); });
        if (std::getenv("ADVEE_GUARDED")) { // a watchdog has started us
            channel("CM_DATA_PROCESSES", [this](const auto &) { unheard = 0; });
            every(LOOK, [this] { look_for_watchdog(); });
        }
    }
    Module(const Module &) = delete;
    Module &operator=(const Module &) = delete;
    virtual ~Module() = default;

    // Runs until the module ends, and returns the exit code.
    int run()
    {
        try {
            const auto all = [this] { announce(), list(timestamp()); };
            all();
            every(ANNOUNCE, all);
            Beat beat = beats.thread("main");
            while (code < 0) {
                beat();
                serve_timers();
                if (code < 0)
                    wait();
            }
        } catch (const std::exception &error) {
            std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
            fatal(UNHANDLED, Kind::Unknown, error.what(), OTHER);
        }
        return code;
    }

protected:
    // Called after a change of state has been announced. In Terminate it is the last call.
    virtual void on_state(State) {}

    // Called before a change of state, for helpers on top of this one.
    virtual void before_state(State) {}

    State state() const { return current; }

    // True if the module may act: only in RUN.
    bool acts() const { return current == State::Run; }

    // Calls the handler for each message. A message of another type is dropped and reported once.
    template <class Message> void subscribe(const std::string &from, std::function<void(const Message &)> handler)
    {
        channel(from, [this, from, handler](const lcm::ReceiveBuffer &raw) {
            Message message;
            std::string why = "it is no " + std::string(Message::getTypeName());
            try {
                if (message.decode(raw.data, 0, int(raw.data_size)) >= 0)
                    why.clear();
            } catch (const std::exception &error) { // invalid counts
                why = error.what();
            }
            if (why.empty())
                handler(message);
            else
                fault(MESSAGE_MALFORMED, Kind::Unknown, Severity::Warning,
                      from + ": a message of " + std::to_string(raw.data_size) + " bytes is dropped: " + why, from);
        });
    }

    // Publishes a message of a type generated by lcm-gen.
    template <class Message> void publish(const std::string &to, const Message &message)
    {
        bus.publish(to, &message);
    }

    // Calls the handler with this period; missed calls are dropped.
    void every(double seconds, std::function<void()> handler)
    {
        timers.push_back(std::make_unique<Timer>(Timer{now() + seconds, seconds, std::move(handler)}));
    }

    // Calls the handler when this descriptor is readable.
    void watch(int fd, std::function<void()> handler)
    {
        polled.push_back({fd, POLLIN, 0});
        handlers.push_back(std::make_unique<std::function<void()>>(std::move(handler)));
    }

    // Reports the device as present: leads out of INIT, and out of ERROR to the previous state. May be repeated.
    void working()
    {
        lost = false;
        if (current == State::Error && before_error != State::Init)
            enter(before_error);
        else if (current == State::Init || current == State::Error)
            enter(wanted);
    }

    // Reports the device as lost: ERROR, until working(). Keep trying. May be repeated.
    void failed()
    {
        lost = true;
        if (current == State::Error || current == State::Terminate)
            return;
        before_error = current;
        enter(State::Error);
    }

    // Raises a fault; reported once until clear(). The meaning of its number, 0x8001 or above, never changes; `subject`
    // distinguishes faults of one number. Raised again, it is listed with the new severity and text.
    void fault(int number, Kind kind, Severity severity, const std::string &text, const std::string &subject = "",
               const char *file = __builtin_FILE(), int line = __builtin_LINE())
    {
        const auto key = std::make_pair(number, subject);
        const auto active = faults.find(key);
        const std::int64_t since = timestamp();
        if (active != faults.end()) {
            const bool news = active->second.severity != severity;
            active->second.severity = severity;
            active->second.message = text;
            if (news)
                list(since);
        } else if (faults.size() < FAULTS_MAX) {
            const bool sent = sends(severity);
            faults.emplace(key, Active{kind, severity, since, text, sent});
            list(since);
            if (sent)
                report(number, kind, severity, text, since, false, file, line);
        }
    }

    // Clears a fault; reported if it was active.
    void clear(int number, const std::string &text, const std::string &subject = "",
               const char *file = __builtin_FILE(), int line = __builtin_LINE())
    {
        const auto found = faults.find({number, subject});
        if (found == faults.end())
            return;
        const Kind kind = found->second.kind;
        const bool sent = found->second.sent;
        faults.erase(found);
        const std::int64_t at = timestamp();
        list(at);
        if (sent)
            report(number, kind, Severity::Notice, text, at, false, file, line);
    }

    // Reports a fatal error, and ends with this exit code, or that of the kind. The watchdog restarts the module.
    void fatal(int number, Kind kind, const std::string &text, int exit = 0, const char *file = __builtin_FILE(),
               int line = __builtin_LINE())
    {
        report(number, kind, Severity::Error, text, timestamp(), true, file, line);
        code = exit ? exit : kind == Kind::Resource ? RESOURCE : kind == Kind::Device ? DEVICE : OTHER;
    }

    // Ends the module in good order, as a TERMINATE command does.
    void end()
    {
        if (current == State::Terminate)
            return;
        enter(State::Terminate);
        if (code < 0)
            code = 0;
    }

    // The text, truncated to the maximum length in a list; characters are never split.
    static std::string clipped(const std::string &text)
    {
        std::size_t end = std::min(text.size(), TEXT_MAX);
        while (end < text.size() && end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80)
            --end;
        return text.substr(0, end);
    }

    const std::string name; // on the bus
    Beats beats;            // for the module's own threads; the loop's heartbeat is sent by run()

private:
    struct Timer {
        double due, period;
        std::function<void()> handler;
    };

    // An active fault: as it was last raised, and the time when it was first raised.
    struct Active {
        Kind kind;
        Severity severity;
        std::int64_t since;
        std::string message;
        bool sent; // its begin was reported, so its end will be
    };

    // A channel and its handler.
    struct Channel {
        std::function<void(const lcm::ReceiveBuffer &)> handler;
        std::exception_ptr thrown;

        void receive(const lcm::ReceiveBuffer *raw, const std::string &)
        {
            try {
                handler(*raw);
            } catch (...) { // exceptions must not pass through liblcm, which is C
                thrown = std::current_exception();
            }
        }
    };

    void channel(const std::string &from, std::function<void(const lcm::ReceiveBuffer &)> handler)
    {
        channels.push_back(std::make_unique<Channel>(Channel{std::move(handler), nullptr}));
        bus.subscribe(from, &Channel::receive, channels.back().get())->setQueueCapacity(BURST);
    }

    void on_bus()
    {
        for (int n = 0; n < BURST && code < 0 && bus.handleTimeout(0) > 0; ++n)
            for (const auto &channel : channels)
                if (channel->thrown)
                    std::rethrow_exception(channel->thrown);
    }

    void wait()
    {
        double wait = beats ? BEAT : ANNOUNCE;
        for (const auto &timer : timers)
            wait = std::min(wait, timer->due - now());
        if (poll(polled.data(), polled.size(), int(std::ceil(1000 * std::max(0.0, wait)))) <= 0)
            return;
        // A handler may add to both lists.
        for (std::size_t n = 0, count = polled.size(); n < count && code < 0; ++n)
            if (polled[n].revents)
                (*handlers[n])();
    }

    void serve_timers()
    {
        for (std::size_t n = 0; n < timers.size() && code < 0; ++n) { // a handler may add one
            Timer &timer = *timers[n];
            const double late = now() - timer.due;
            if (late < 0)
                continue;
            timer.due += timer.period * (1 + std::floor(late / timer.period));
            timer.handler();
        }
    }

    void look_for_watchdog()
    {
        // Checks are counted, not seconds: a delayed process checks once, and then receives the queued messages.
        if (++unheard <= ORPHANED)
            return;
        std::fprintf(stderr, "%s: the watchdog is gone: it ends\n", name.c_str());
        end();
    }

    // True if the table allows a command from one state to another; without TERMINATE.
    static bool allows(State from, State to, bool manual)
    {
        switch (to) {
        case State::Run: return from == State::Pause || (from == State::Stop && manual);
        case State::Pause: return from == State::Run || (from == State::Stop && manual);
        case State::Stop: return manual;
        default: return false;
        }
    }

    void obey(const common::cmd_state_t &command)
    {
        const State to = State(command.state);
        const bool manual = command.manual != 0;
        if ((command.module != name && command.module != "*") || to == current || current == State::Terminate)
            return;
        if (command.state < 0 || command.state > int(State::Pause)) {
            forbidden("command from " + command.source + " refused: " + std::to_string(command.state) + " is no state");
        } else if (to == State::Terminate) {
            end();
        } else if (allows(current, to, manual)) {
            if (current == State::Init)
                wanted = to;
            enter(to);
            // A command led it through STOP out of ERROR; its device is still lost.
            if (lost && (current == State::Run || current == State::Pause))
                failed();
        } else {
            forbidden(std::string(manual ? "manual " : "") + "command " + name_of(to) + " from " + command.source +
                      " refused in " + name_of(current));
        }
    }

    // Obeys a command for the level from which reports are sent. Its watchdog prints and sends its lines, and answers.
    void set_level(const common::cmd_level_t &command)
    {
        const int unchanged = common::cmd_level_t::UNCHANGED, configured = common::cmd_level_t::CONFIGURED;
        const auto good = [&](int value) {
            return (value >= LEVEL_DEBUG && value <= LEVEL_ERROR) || value == unchanged || value == configured;
        };
        if (command.module != name && command.module != "*")
            return;
        if (!good(command.print_from) || !good(command.send_from))
            refuse_level(good(command.print_from) ? command.send_from : command.print_from, command.source);
        else if (command.send_from == configured)
            send_from = LEVEL_DEBUG;
        else if (command.send_from != unchanged)
            send_from = command.send_from;
    }

    // Counts a refused command for the levels, and reports at most one each second.
    void refuse_level(int value, const std::string &source)
    {
        ++refused;
        if (now() - refusal < REFUSALS)
            return;
        const std::string more =
            refused > 1 ? "; " + std::to_string(refused) + " refused since the last report" : std::string();
        refused = 0;
        refusal = now();
        forbidden("command from " + source + " refused: " + std::to_string(value) + " is no level" + more);
    }

    void forbidden(const std::string &text, const char *file = __builtin_FILE(), int line = __builtin_LINE())
    {
        if (sends(Severity::Warning))
            report(COMMAND_FORBIDDEN, Kind::Unknown, Severity::Warning, text, timestamp(), false, file, line);
    }

    bool sends(Severity severity) const { return int(severity) + 1 >= send_from; }

    void enter(State to)
    {
        before_state(to);
        current = to;
        announce();
        on_state(to);
    }

    void announce()
    {
        common::data_state_t message;
        message.timestamp = timestamp();
        message.module = name;
        message.state = std::int8_t(current);
        publish("CM_DATA_STATE", message);
    }

    // Publishes the active faults, before the report of the same moment, so that its subject is known.
    void list(std::int64_t at)
    {
        common::data_faults_t message;
        message.timestamp = at;
        message.module = name;
        for (const auto &active : faults) {
            common::fault_t fault;
            fault.number = active.first.first;
            fault.subject = clipped(active.first.second);
            fault.severity = std::int8_t(active.second.severity);
            fault.since = active.second.since;
            fault.message = clipped(active.second.message);
            message.faults.push_back(fault);
        }
        message.count = std::int32_t(message.faults.size());
        publish("CM_DATA_FAULTS", message);
    }

    void report(int number, Kind kind, Severity severity, const std::string &text, std::int64_t at, bool fatal = false,
                const char *file = __builtin_FILE(), int line = __builtin_LINE())
    {
        const char *base = std::strrchr(file, '/');
        common::error_t message;
        message.timestamp = at;
        message.module = name;
        message.number = number;
        message.message = text;
        message.fatal = fatal;
        message.type = std::int8_t(kind);
        message.severity = std::int8_t(severity);
        message.file = base ? base + 1 : file;
        message.line = line;
        publish("CM_EVENT_ERROR", message);
    }

    Signals signals;
    std::vector<std::unique_ptr<Channel>> channels;
    lcm::LCM bus;
    std::vector<std::unique_ptr<Timer>> timers;
    std::vector<pollfd> polled;
    std::vector<std::unique_ptr<std::function<void()>>> handlers;
    std::map<std::pair<int, std::string>, Active> faults;
    State current = State::Init, before_error = State::Init, wanted;
    bool lost = false; // last report of the module about its device
    int send_from = LEVEL_DEBUG; // level from which reports are sent
    unsigned refused = 0;        // commands for the levels since the last report of one
    double refusal = -REFUSALS;  // s; time of that report
    int unheard = 0;   // checks since the last message of the watchdog
    int code = -1; // 0 or above: the module ends with this code
};

// Creates the module of this class, runs it, and returns the exit code. Further arguments go to its constructor.
template <class Watch, class... Arguments> int run(const Options &options, Arguments &&...arguments)
{
    try {
        return Watch(options, std::forward<Arguments>(arguments)...).run();
    } catch (const std::exception &error) { // from its constructor: it has not announced itself yet
        std::fprintf(stderr, "%s: %s\n", options.name.c_str(), error.what());
        return OTHER;
    }
}

} // namespace advee
