// Module that fails in every way that the helper must handle, selected by its argument; broken.py in C++.
#include "advee.hpp"
#include <atomic>
#include <stdexcept>
#include <thread>

namespace {

class Broken : public advee::Module {
public:
    explicit Broken(const advee::Options &options) : Module(options), how(options.rest.at(0))
    {
        if (how == "constructor")
            throw std::runtime_error("in its constructor");
        every(0.01, [this] { on_tick(); });
        if (how == "worker")
            worker = std::thread([this] { work(); });
    }

    ~Broken() override
    {
        ends = true;
        if (worker.joinable())
            worker.join();
    }

private:
    void on_tick()
    {
        working();
        if (how == "timer")
            throw std::runtime_error("in a timer");
        if (how == "device")
            fatal(0x8001, advee::Kind::Device, "the device burns", advee::DEVICE + 3);
    }

    void on_state(advee::State state) override
    {
        if (how == "state" && state == advee::State::Pause)
            throw std::runtime_error("on a command");
        hangs = state == advee::State::Pause;
    }

    // Sends heartbeats except in PAUSE, where it waits for an event that never comes.
    void work()
    {
        advee::Beat beat = beats.thread("worker");
        while (!ends) {
            if (!hangs)
                beat();
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
    }

    const std::string how;
    std::atomic<bool> hangs{false}, ends{false};
    std::thread worker;
};

} // namespace

int main(int argc, char **argv)
{
    return advee::run<Broken>(advee::Options("broken_cpp", argc, argv));
}
