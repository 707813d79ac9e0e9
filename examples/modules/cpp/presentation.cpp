// Plays presentations: shows a text, sentence by sentence, in a given time.
//
//     presentation
//     advee action present text="Good morning. My name is Advee." seconds=6
//
// A module in C++ that offers an action: docs/highlevel.md; presentation.py in C++. The sentences are lines on its
// standard error, which its watchdog prints and sends on CM_EVENT_TEXT.
#include "actions.hpp"

using advee::ActionPtr;
using advee::Rejected;

namespace {

constexpr double RATE = 15.0;                // characters that people read in a second
constexpr double SHORTEST = 0.1, LONGEST = 600.0; // s; limits of the parameter
constexpr double TICK = 0.1;                 // s

// The text in sentences, each with single spaces.
std::vector<std::string> sentences_of(const std::string &text)
{
    std::vector<std::string> sentences;
    bool begins = true, space = false;
    for (const char letter : text) {
        if (std::isspace(static_cast<unsigned char>(letter))) {
            space = true;
            continue;
        }
        if (space && !begins && std::strchr(".!?", sentences.back().back()))
            begins = true;
        if (begins)
            sentences.emplace_back();
        else if (space)
            sentences.back() += ' ';
        sentences.back() += letter;
        begins = space = false;
    }
    return sentences;
}

class Presentation : public advee::Performer {
public:
    explicit Presentation(const advee::Options &options) : Performer(options)
    {
        offer("present", [this](const ActionPtr &next) { on_present(next); },
              [this](const ActionPtr &) { on_cancel(); });
        every(TICK, [this] { on_tick(); });
    }

private:
    void on_present(const ActionPtr &next)
    {
        if (action)
            throw Rejected(action->id + " is played");
        const std::string text = next->text("text");
        std::vector<std::string> all = sentences_of(text);
        if (all.empty())
            throw Rejected("the text is empty");
        const double usual = std::min(std::max(2.0, double(text.size()) / RATE), LONGEST);
        seconds = next->number("seconds", SHORTEST, LONGEST, usual);
        sentences = std::move(all);
        shown = 0;
        action = next;
        begun = advee::now();
        play();
    }

    void on_cancel()
    {
        const ActionPtr done = std::move(action);
        action = nullptr;
        done->cancelled("after " + std::to_string(shown) + " of " + std::to_string(sentences.size()) + " sentences");
    }

    void on_tick()
    {
        working();
        if (action)
            play();
    }

    void play()
    {
        const double share = (advee::now() - begun) / seconds;
        const std::size_t due = std::min(std::size_t(share * double(sentences.size())) + 1, sentences.size());
        for (; shown < due; ++shown)
            std::fprintf(stderr, "<6>%s\n", sentences[shown].c_str());
        if (share < 1) {
            action->run(share, sentences[due - 1]);
            return;
        }
        const ActionPtr done = std::move(action);
        action = nullptr;
        char text[64];
        std::snprintf(text, sizeof text, "%zu sentences in %g s", due, seconds);
        done->succeed(text);
    }

    ActionPtr action; // that is played
    std::vector<std::string> sentences;
    std::size_t shown = 0;
    double begun = 0, seconds = 0;
};

} // namespace

int main(int argc, char **argv)
{
    const advee::Options options("presentation", argc, argv);
    if (!options.rest.empty())
        options.refuse(options.rest[0] + ": no arguments expected");
    return advee::run<Presentation>(options);
}
