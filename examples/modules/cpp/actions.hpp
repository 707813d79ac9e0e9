// Actions that a module in C++17 offers: HL_CMD_ACTION and HL_DATA_ACTION (docs/highlevel.md); actions.py in C++.
//
//     class Greeter : public advee::Performer {
//     public:
//         explicit Greeter(const advee::Options &options) : Performer(options)
//         {
//             offer("greet", [](const auto &action) { action->succeed("greeted " + action->text("name")); });
//             every(0.1, [this] { working(); }); // it needs no device
//         }
//     };
//
// The helper answers each command, rejects those beyond the limits and those that come while the module is not in RUN,
// repeats the status each second, knows repeated commands by their id, and fails what is under way when the module
// leaves RUN. All calls come from the module's loop, and all methods are called from it.
#pragma once

#include <cctype>
#include <deque>
#include <stdexcept>
#include "advee.hpp"
#include "highlevel/cmd_action_t.hpp"
#include "highlevel/data_action_t.hpp"

namespace advee {

constexpr std::size_t ID_MAX = 128, NAME_MAX_BYTES = 64; // bytes of an id, of a name
constexpr std::size_t PARAMETERS_MAX = 32, VALUE_MAX = 4096; // parameters of a command; bytes of a value
constexpr double ACTION_PERIOD = 1.0; // s between two statuses of an action that lasts
constexpr double AGAIN = 0.1; // s at least between two statuses that differ in the progress alone
constexpr int ENDS = 3; // times that an end is published
constexpr std::size_t UNDER_WAY_MAX = 16; // actions at a time; further ones are rejected
constexpr std::size_t ENDED_MAX = 64; // actions that have ended and are known by their id

// Statuses, by their values on the wire.
enum class Status : std::int8_t { Accepted, Running, Succeeded, Failed, Cancelled, Rejected };

// To be thrown when an action is about to begin: it is rejected, with this reason.
struct Rejected : std::runtime_error {
    using std::runtime_error::runtime_error;
};

class Performer;

// An action that was commanded.
class Action {
public:
    const std::string id, name;
    std::map<std::string, std::string> parameters;

    Action(Performer &performer, const highlevel::cmd_action_t &command)
        : id(command.id), name(command.name), performer(performer)
    {
        for (const auto &parameter : command.parameters)
            parameters[parameter.name] = parameter.value;
    }

    // True once it has ended.
    bool over() const { return status >= Status::Succeeded; }

    // Returns a parameter; without it the action is rejected.
    std::string text(const std::string &key) const
    {
        const auto found = parameters.find(key);
        if (found == parameters.end())
            throw Rejected("parameter " + key + " is missing");
        return found->second;
    }

    // Returns a parameter as a number from low to high, else the action is rejected.
    double number(const std::string &key, double low, double high) const
    {
        const std::string value = text(key);
        char *end = nullptr;
        const double number = std::strtod(value.c_str(), &end);
        if (value.empty() || end != value.c_str() + value.size() || !(number >= low && number <= high)) {
            char limits[64];
            std::snprintf(limits, sizeof limits, "%g to %g", low, high);
            throw Rejected("parameter " + key + " is no number from " + limits);
        }
        return number;
    }

    // The same; without the parameter the default, which needs no limits.
    double number(const std::string &key, double low, double high, double otherwise) const
    {
        return parameters.count(key) ? number(key, low, high) : otherwise;
    }

    // Reports that it is under way: progress 0 to 1, or NaN if that is not known; what is done now.
    void run(double progress = NAN, const std::string &message = "") { change(Status::Running, progress, message); }
    // Ends it: it has reached its aim.
    void succeed(const std::string &message = "") { change(Status::Succeeded, 1.0, message); }
    // Ends it: it has not reached its aim, for this reason.
    void fail(const std::string &message) { change(Status::Failed, share, message); }
    // Ends it because it was cancelled; as Failed where that was because the module left RUN.
    void cancelled(const std::string &message = "")
    {
        if (lost.empty())
            change(Status::Cancelled, share, message);
        else
            fail(lost);
    }

private:
    friend class Performer;

    // Rejects it; after its start it has failed.
    void reject(const std::string &reason)
    {
        change(status == Status::Accepted ? Status::Rejected : Status::Failed, share, reason);
    }

    void change(Status to, double progress, const std::string &message);

    Performer &performer;
    Status status = Status::Accepted;
    double share = NAN;        // progress
    std::string words, lost;   // message; why the module ends it
    bool cancelling = false;
    double published = -INFINITY; // time of the last status
    int ends = 0;              // times that its end is still published
};

// Shared by the helper, which keeps those that have ended for a while, and the module.
using ActionPtr = std::shared_ptr<Action>;
using ActionHandler = std::function<void(const ActionPtr &)>;

// A module that offers actions: call offer() in the constructor.
class Performer : public Module {
public:
    explicit Performer(const Options &options) : Module(options)
    {
        subscribe<highlevel::cmd_action_t>("HL_CMD_ACTION", [this](const auto &command) { on_action(command); });
        every(ACTION_PERIOD, [this] { repeat(); });
    }

protected:
    // Offers the action of this name. `begin` is called for each one, in RUN: it starts the work, or throws Rejected,
    // and returns quickly; run() reports progress, succeed(), fail() or cancelled() its end, then or later. `cancel` is
    // called once when it is cancelled, and when the module leaves RUN: what is under way is stopped, and cancelled()
    // called as soon as it is; without `cancel` that is at once.
    void offer(const std::string &action, ActionHandler begin, ActionHandler cancel = nullptr)
    {
        if (!is_name(action))
            throw std::invalid_argument(action + " is no name of an action");
        offers[action] = Offer{std::move(begin), std::move(cancel)};
    }

    // The actions under way, in the order of their commands.
    const std::vector<ActionPtr> &actions() const { return under_way; }

private:
    friend class Action;

    struct Offer {
        ActionHandler begin, cancel;
    };

    static bool is_id(const std::string &text)
    {
        const auto printable = [](char letter) { return letter > ' ' && letter <= '~'; };
        return !text.empty() && text.size() <= ID_MAX && std::all_of(text.begin(), text.end(), printable);
    }

    static bool is_name(const std::string &text)
    {
        const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
        const auto other = [&](char c) {
            return letter(c) || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
        };
        return !text.empty() && text.size() <= NAME_MAX_BYTES && letter(text[0]) &&
               std::all_of(text.begin(), text.end(), other);
    }

    void on_action(const highlevel::cmd_action_t &command)
    {
        if (!is_id(command.id)) {
            fault(MESSAGE_MALFORMED, Kind::Unknown, Severity::Warning,
                  "HL_CMD_ACTION: a command without a valid id is dropped", "HL_CMD_ACTION");
            return;
        }
        const ActionPtr known = find(command.id);
        if (known) {
            if (command.cancel && !known->over())
                cancel(known);
            if (now() - known->published >= AGAIN)
                publish_status(*known);
        } else if (offers.count(command.name)) {
            begin(std::make_shared<Action>(*this, command), command);
        }
    }

    ActionPtr find(const std::string &id) const
    {
        const auto is = [&](const ActionPtr &action) { return action->id == id; };
        const auto here = std::find_if(under_way.begin(), under_way.end(), is);
        if (here != under_way.end())
            return *here;
        const auto there = std::find_if(ended.begin(), ended.end(), is);
        return there != ended.end() ? *there : nullptr;
    }

    void begin(const ActionPtr &action, const highlevel::cmd_action_t &command)
    {
        under_way.push_back(action);
        if (command.cancel) {
            action->cancelled("it was not under way");
            return;
        }
        const std::string reason = objection(command);
        if (!reason.empty()) {
            action->reject(reason);
            return;
        }
        try {
            offers[action->name].begin(action);
        } catch (const Rejected &rejected) {
            action->reject(rejected.what());
        }
        if (std::isinf(action->published)) // its work has begun without a report
            publish_status(*action);
    }

    // Why a command is rejected; empty if it is accepted.
    std::string objection(const highlevel::cmd_action_t &command) const
    {
        if (!acts())
            return name + " is in " + name_of(state());
        if (under_way.size() > UNDER_WAY_MAX)
            return name + " has " + std::to_string(UNDER_WAY_MAX) + " actions under way";
        if (command.parameters.size() > PARAMETERS_MAX)
            return std::to_string(command.parameters.size()) + " parameters are more than " +
                   std::to_string(PARAMETERS_MAX);
        std::map<std::string, int> names;
        for (const auto &parameter : command.parameters)
            if (!is_name(parameter.name) || names[parameter.name]++ > 0)
                return "a parameter has no valid name, or that of another one";
        for (const auto &parameter : command.parameters)
            if (parameter.value.size() > VALUE_MAX)
                return "the value of a parameter has more than " + std::to_string(VALUE_MAX) + " bytes";
        return "";
    }

    void cancel(const ActionPtr &action)
    {
        if (action->cancelling)
            return;
        action->cancelling = true;
        const ActionHandler &handler = offers[action->name].cancel;
        if (handler)
            handler(action);
        else
            action->cancelled();
    }

    // Keeps an action that has ended, instead of the oldest one.
    void on_end(Action &action)
    {
        const auto is = [&](const ActionPtr &other) { return other.get() == &action; };
        const auto found = std::find_if(under_way.begin(), under_way.end(), is);
        if (found == under_way.end())
            return;
        ended.push_back(*found);
        under_way.erase(found);
        action.parameters.clear();
        if (ended.size() > ENDED_MAX)
            ended.pop_front();
    }

    void repeat()
    {
        for (const auto &action : under_way)
            publish_status(*action);
        for (const auto &action : ended)
            if (action->ends > 0) {
                --action->ends;
                publish_status(*action);
            }
    }

    void publish_status(Action &action)
    {
        action.published = now();
        highlevel::data_action_t message;
        message.timestamp = timestamp();
        message.id = action.id;
        message.status = std::int8_t(action.status);
        message.progress = action.share;
        message.message = clipped(action.words);
        publish("HL_DATA_ACTION", message);
    }

    // When the module leaves RUN, what is under way has failed.
    void before_state(State to) override
    {
        if (to == State::Run)
            return;
        const std::vector<ActionPtr> lasting = under_way;
        for (const auto &action : lasting) {
            action->lost = name + " is in " + name_of(to);
            cancel(action);
            action->cancelled();
        }
    }

    std::map<std::string, Offer> offers;
    std::vector<ActionPtr> under_way;
    std::deque<ActionPtr> ended;
};

// Changes the status. After the end nothing changes; a new progress alone is not published too often.
inline void Action::change(Status to, double progress, const std::string &message)
{
    if (over())
        return;
    const bool news = status != to || words != message;
    status = to;
    words = message;
    share = progress >= 0 && progress <= 1 ? progress : NAN;
    if (news || now() - published >= AGAIN)
        performer.publish_status(*this);
    if (over()) {
        ends = ENDS - 1;
        performer.on_end(*this);
    }
}

} // namespace advee
