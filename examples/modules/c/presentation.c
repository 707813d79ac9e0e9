/* Plays presentations: shows a text, sentence by sentence, in a given time.
 *
 *     presentation
 *     advee action present text="Good morning. My name is Advee." seconds=6
 *
 * A module in C that offers an action: docs/highlevel.md; presentation.py in C. The sentences are lines on its standard
 * error, which its watchdog prints and sends on CM_EVENT_TEXT. */
#include "actions.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const double RATE = 15.0;                    /* characters that people read in a second */
static const double SHORTEST = 0.1, LONGEST = 600.0; /* s; limits of the parameter */
static const double TICK = 0.1;                     /* s */
enum { TEXT_BYTES = 4096, SENTENCES = TEXT_BYTES / 2 }; /* a sentence and the blank after it have two bytes at least */

typedef struct {
    advee_action_t action; /* that is played; 0: none */
    char text[TEXT_BYTES + 1];
    const char *sentences[SENTENCES + 1];
    size_t count, shown;
    double begun, seconds;
} presentation_t;

/* Splits a text into sentences, each with single blanks. */
static void split(presentation_t *play, const char *text)
{
    char *end = play->text;
    bool begins = true, blank = false;
    play->count = 0;
    for (; *text; ++text) {
        if (isspace((unsigned char)*text)) {
            blank = true;
            continue;
        }
        if (blank && !begins) {
            begins = strchr(".!?", end[-1]) != NULL;
            *end++ = begins ? 0 : ' ';
        }
        if (begins)
            play->sentences[play->count++] = end;
        *end++ = *text;
        begins = blank = false;
    }
    *end = 0;
}

static void play_on(advee_t *module, presentation_t *play)
{
    const double share = (advee_now() - play->begun) / play->seconds;
    const size_t due = (size_t)fmin(floor(share * (double)play->count) + 1, (double)play->count);
    for (; play->shown < due; ++play->shown)
        fprintf(stderr, "<6>%s\n", play->sentences[play->shown]);
    if (share < 1) {
        advee_action_run(module, play->action, share, "%s", play->sentences[due - 1]);
        return;
    }
    const advee_action_t done = play->action;
    play->action = 0;
    advee_action_succeed(module, done, "%zu sentences in %g s", due, play->seconds);
}

static void on_present(advee_t *module, advee_action_t next)
{
    presentation_t *play = advee_user(module);
    if (play->action) {
        advee_action_reject(module, next, "%s is played", advee_action_id(module, play->action));
        return;
    }
    const char *text = advee_action_text(module, next, "text", NULL);
    if (!text)
        return;
    split(play, text);
    if (play->count == 0) {
        advee_action_reject(module, next, "the text is empty");
        return;
    }
    const double usual = fmin(fmax(2.0, (double)strlen(text) / RATE), LONGEST);
    if (!advee_action_number(module, next, "seconds", SHORTEST, LONGEST, usual, &play->seconds))
        return;
    play->shown = 0;
    play->action = next;
    play->begun = advee_now();
    play_on(module, play);
}

static void on_cancel(advee_t *module, advee_action_t action)
{
    presentation_t *play = advee_user(module);
    play->action = 0;
    advee_action_cancelled(module, action, "after %zu of %zu sentences", play->shown, play->count);
}

static void on_tick(advee_t *module)
{
    presentation_t *play = advee_user(module);
    advee_working(module);
    if (play->action)
        play_on(module, play);
}

int main(int argc, char **argv)
{
    advee_options_t options = advee_options("presentation", argc, argv);
    if (options.rests > 0)
        advee_refuse(&options, "%s: no arguments expected", options.rest[0]);
    static presentation_t play;
    advee_t *module = advee_create(&options, &play);
    advee_actions(module);
    advee_offer(module, "present", on_present, on_cancel);
    advee_every(module, TICK, on_tick);
    return advee_run(module);
}
