// Publishes the nearest obstacle seen by a sonar on LL_DATA_NEAREST, and reports one that is too near.
//
//     nearest_obstacle [METRES]        limit for "too near" [0.25]
//
// A module in C++: docs/writing-a-module.md. Its device is LL_DATA_SRFS; its message is its own, data_nearest_t.lcm.
#include "advee.hpp"
#include "example/data_nearest_t.hpp"
#include "lowlevel/data_srfs_t.hpp"

using advee::Kind;
using advee::Severity;

namespace {

constexpr double MARGIN = 0.1; // m beyond the limit: clears the fault
constexpr double SILENT = 1.0; // s; the sonars are polled at least four times a second
constexpr int SONARS_SILENT = 0x8001, TOO_NEAR = 0x8002;

class NearestObstacle : public advee::Module {
public:
    NearestObstacle(const advee::Options &options, double limit) : Module(options), limit(limit)
    {
        subscribe<lowlevel::data_srfs_t>("LL_DATA_SRFS", [this](const auto &sonars) { on_sonars(sonars.srfs); });
        every(0.1, [this] { on_look(); });
    }

private:
    void on_sonars(const std::vector<lowlevel::range_t> &ranges)
    {
        heard = advee::now();
        clear(SONARS_SILENT, "the sonars are heard again");
        working();
        if (!acts())
            return;
        example::data_nearest_t nearest{};
        nearest.timestamp = advee::timestamp();
        nearest.distance = nearest.x = nearest.y = NAN;
        for (const auto &range : ranges) {
            if (!range.valid || (nearest.valid && range.distance >= nearest.distance))
                continue;
            nearest.valid = true;
            nearest.distance = range.distance;
            nearest.x = range.x + range.distance * std::cos(range.theta);
            nearest.y = range.y + range.distance * std::sin(range.theta);
        }
        publish("LL_DATA_NEAREST", nearest);
        if (nearest.distance < limit)
            fault(TOO_NEAR, Kind::Unknown, Severity::Warning, "something is nearer than " + metres(limit));
        else if (!nearest.valid || nearest.distance >= limit + MARGIN)
            clear(TOO_NEAR, "nothing is nearer than " + metres(limit + MARGIN));
    }

    void on_look()
    {
        if (advee::now() < heard + SILENT)
            return;
        fault(SONARS_SILENT, Kind::Timeout, Severity::Error, "no LL_DATA_SRFS: is driver_rs485a there?");
        failed();
    }

    static std::string metres(double value)
    {
        char text[32];
        std::snprintf(text, sizeof text, "%.2f m", value);
        return text;
    }

    const double limit;
    double heard = advee::now();
};

} // namespace

int main(int argc, char **argv)
{
    const advee::Options options("nearest_obstacle", argc, argv);
    char *end = nullptr;
    const double limit = options.rest.empty() ? 0.25 : std::strtod(options.rest[0].c_str(), &end);
    if (options.rest.size() > 1 || (end && *end) || !(limit > 0))
        options.refuse("expected one number, the metres that are too near");
    return advee::run<NearestObstacle>(options, limit);
}
