/* Documented in actions.h. */
#define _GNU_SOURCE
#include "actions.h"

#include "highlevel_cmd_action_t.h"
#include "highlevel_data_action_t.h"
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double PERIOD = 1.0; /* s between two statuses of an action that lasts */
static const double AGAIN = 0.1;  /* s at least between two statuses that differ in the progress alone */
enum {
    ID_MAX = 128,        /* bytes of an id */
    NAME_BYTES = 64,     /* bytes of a name */
    PARAMETERS_MAX = 32, /* parameters of a command */
    VALUE_MAX = 4096,    /* bytes of a value */
    MESSAGE_MAX = 512,   /* bytes of a message */
    ENDS = 3,            /* times that an end is published */
    UNDER_WAY_MAX = 16,  /* actions at a time; further ones are rejected */
    ENDED_MAX = 64,      /* actions that have ended and are known by their id */
    OFFERS_MAX = 64,     /* names that are offered */
};

typedef struct {
    char name[NAME_BYTES + 1];
    void (*begin)(advee_t *, advee_action_t);
    void (*cancel)(advee_t *, advee_action_t);
} offer_t;

typedef struct {
    char *name, *value;
} parameter_t;

/* An action that is under way, or has ended and is still known. */
typedef struct {
    advee_action_t number; /* 0: a free place */
    char id[ID_MAX + 1];
    const offer_t *offer;
    parameter_t parameters[PARAMETERS_MAX];
    int parameter_count;
    int8_t status;
    double progress;
    char message[MESSAGE_MAX + 1];
    char lost[MESSAGE_MAX + 1]; /* why the module ends it; "" if it does not */
    bool cancelling;
    double published; /* time of the last status */
    int ends;         /* times that its end is still published */
} entry_t;

/* At most one module for each process. */
static offer_t offers[OFFERS_MAX];
static size_t offer_count;
/* In the order of their commands; one more place for the action that is about to be rejected. */
static entry_t under_way[UNDER_WAY_MAX + 1];
static size_t under_way_count;
static entry_t ended[ENDED_MAX];
static size_t oldest;
static advee_action_t last_number;

/* --- small things --- */

static bool is_id(const char *text)
{
    const size_t length = strnlen(text, ID_MAX + 1);
    for (size_t n = 0; n < length; ++n)
        if (text[n] <= ' ' || text[n] > '~')
            return false;
    return length >= 1 && length <= ID_MAX;
}

static bool is_letter(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

static bool is_name(const char *text)
{
    const size_t length = strnlen(text, NAME_BYTES + 1);
    for (size_t n = 0; n < length; ++n) {
        const char c = text[n];
        const bool other = (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
        if (!is_letter(c) && (n == 0 || !other))
            return false;
    }
    return length >= 1 && length <= NAME_BYTES;
}

/* Writes a message of at most MESSAGE_MAX bytes; characters are never split. */
static void write_message(char *to, const char *text, va_list arguments)
{
    const int length = vsnprintf(to, MESSAGE_MAX + 1, text, arguments);
    if (length <= MESSAGE_MAX)
        return;
    size_t end = MESSAGE_MAX;
    while (end > 0 && ((unsigned char)to[end - 1] & 0xC0) == 0x80)
        --end;
    /* A character of several bytes that is complete stays. */
    if (end > 0 && (unsigned char)to[end - 1] >= 0xC0) {
        const unsigned char lead = (unsigned char)to[end - 1];
        const size_t bytes = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
        end = end - 1 + bytes <= MESSAGE_MAX ? end - 1 + bytes : end - 1;
    }
    to[end] = 0;
}

static char *copied(const char *text)
{
    char *copy = strdup(text);
    if (!copy) {
        fputs("out of memory\n", stderr);
        exit(ADVEE_RESOURCE);
    }
    return copy;
}

static entry_t *find(advee_action_t number)
{
    if (number == 0)
        return NULL;
    for (size_t n = 0; n < under_way_count; ++n)
        if (under_way[n].number == number)
            return &under_way[n];
    for (size_t n = 0; n < ENDED_MAX; ++n)
        if (ended[n].number == number)
            return &ended[n];
    return NULL;
}

static entry_t *find_by_id(const char *id)
{
    for (size_t n = 0; n < under_way_count; ++n)
        if (strcmp(under_way[n].id, id) == 0)
            return &under_way[n];
    for (size_t n = 0; n < ENDED_MAX; ++n)
        if (ended[n].number != 0 && strcmp(ended[n].id, id) == 0)
            return &ended[n];
    return NULL;
}

static bool over(const entry_t *action)
{
    return action->status >= HIGHLEVEL_DATA_ACTION_T_SUCCEEDED;
}

/* --- status --- */

static void publish_status(advee_t *module, entry_t *action)
{
    action->published = advee_now();
    highlevel_data_action_t message = {
        .timestamp = advee_timestamp(),
        .id = action->id,
        .status = action->status,
        .progress = action->progress,
        .message = action->message,
    };
    highlevel_data_action_t_publish(advee_bus(module), "HL_DATA_ACTION", &message);
}

/* Keeps an action that has ended, instead of the oldest one. */
static void on_end(entry_t *action)
{
    for (int n = 0; n < action->parameter_count; ++n) {
        free(action->parameters[n].name);
        free(action->parameters[n].value);
    }
    action->parameter_count = 0;
    ended[oldest] = *action;
    oldest = (oldest + 1) % ENDED_MAX;
    const size_t place = (size_t)(action - under_way);
    memmove(action, action + 1, (under_way_count - place - 1) * sizeof *action);
    --under_way_count;
}

/* Changes the status. After the end nothing changes; a new progress alone is not published too often. */
static void change(advee_t *module, advee_action_t number, int8_t status, double progress, const char *text,
                   va_list arguments)
{
    entry_t *action = find(number);
    if (!action || over(action))
        return;
    char message[MESSAGE_MAX + 1];
    write_message(message, text, arguments);
    const bool news = status != action->status || strcmp(message, action->message) != 0;
    action->status = status;
    strcpy(action->message, message);
    action->progress = progress >= 0 && progress <= 1 ? progress : NAN;
    if (news || advee_now() - action->published >= AGAIN)
        publish_status(module, action);
    if (over(action)) {
        action->ends = ENDS - 1;
        on_end(action);
    }
}

static double progress_of(advee_action_t number)
{
    const entry_t *action = find(number);
    return action ? action->progress : NAN;
}

void advee_action_run(advee_t *module, advee_action_t action, double progress, const char *message, ...)
{
    va_list arguments;
    va_start(arguments, message);
    change(module, action, HIGHLEVEL_DATA_ACTION_T_RUNNING, progress, message, arguments);
    va_end(arguments);
}

void advee_action_succeed(advee_t *module, advee_action_t action, const char *message, ...)
{
    va_list arguments;
    va_start(arguments, message);
    change(module, action, HIGHLEVEL_DATA_ACTION_T_SUCCEEDED, 1.0, message, arguments);
    va_end(arguments);
}

void advee_action_fail(advee_t *module, advee_action_t action, const char *why, ...)
{
    va_list arguments;
    va_start(arguments, why);
    change(module, action, HIGHLEVEL_DATA_ACTION_T_FAILED, progress_of(action), why, arguments);
    va_end(arguments);
}

void advee_action_cancelled(advee_t *module, advee_action_t action, const char *message, ...)
{
    const entry_t *known = find(action);
    if (known && known->lost[0]) {
        char why[MESSAGE_MAX + 1];
        strcpy(why, known->lost);
        advee_action_fail(module, action, "%s", why);
        return;
    }
    va_list arguments;
    va_start(arguments, message);
    change(module, action, HIGHLEVEL_DATA_ACTION_T_CANCELLED, progress_of(action), message, arguments);
    va_end(arguments);
}

void advee_action_reject(advee_t *module, advee_action_t action, const char *why, ...)
{
    const entry_t *known = find(action);
    const bool fresh = known && known->status == HIGHLEVEL_DATA_ACTION_T_ACCEPTED;
    va_list arguments;
    va_start(arguments, why);
    change(module, action, fresh ? HIGHLEVEL_DATA_ACTION_T_REJECTED : HIGHLEVEL_DATA_ACTION_T_FAILED,
           progress_of(action), why, arguments);
    va_end(arguments);
}

/* --- for the module --- */

const char *advee_action_id(advee_t *module, advee_action_t action)
{
    (void)module;
    const entry_t *known = find(action);
    return known ? known->id : "";
}

const char *advee_action_name(advee_t *module, advee_action_t action)
{
    (void)module;
    const entry_t *known = find(action);
    return known ? known->offer->name : "";
}

bool advee_action_over(advee_t *module, advee_action_t action)
{
    (void)module;
    const entry_t *known = find(action);
    return !known || over(known);
}

static const char *parameter(advee_action_t action, const char *key)
{
    const entry_t *known = find(action);
    for (int n = 0; known && n < known->parameter_count; ++n)
        if (strcmp(known->parameters[n].name, key) == 0)
            return known->parameters[n].value;
    return NULL;
}

const char *advee_action_text(advee_t *module, advee_action_t action, const char *key, const char *otherwise)
{
    const char *value = parameter(action, key);
    if (!value && !otherwise)
        advee_action_reject(module, action, "parameter %s is missing", key);
    return value ? value : otherwise;
}

bool advee_action_number(advee_t *module, advee_action_t action, const char *key, double low, double high,
                         double otherwise, double *value)
{
    if (!parameter(action, key) && !isnan(otherwise)) {
        *value = otherwise;
        return true;
    }
    const char *text = advee_action_text(module, action, key, NULL);
    if (!text)
        return false;
    char *end = NULL;
    const double number = strtod(text, &end);
    if (end == text || *end || !(number >= low && number <= high)) {
        advee_action_reject(module, action, "parameter %s is no number from %g to %g", key, low, high);
        return false;
    }
    *value = number;
    return true;
}

/* --- the contract --- */

static void cancel(advee_t *module, advee_action_t number)
{
    entry_t *action = find(number);
    if (!action || action->cancelling)
        return;
    action->cancelling = true;
    if (action->offer->cancel)
        action->offer->cancel(module, number);
    else
        advee_action_cancelled(module, number, "%s", "");
}

/* Rejects a command for which there is a reason; true if there is one. */
static bool objects(advee_t *module, advee_action_t action, const highlevel_cmd_action_t *command)
{
    if (!advee_acts(module)) {
        advee_action_reject(module, action, "%s is in %s", advee_name(module), advee_state_name(advee_state(module)));
        return true;
    }
    if (under_way_count > UNDER_WAY_MAX) {
        advee_action_reject(module, action, "%s has %d actions under way", advee_name(module), UNDER_WAY_MAX);
        return true;
    }
    if (command->count > PARAMETERS_MAX) {
        advee_action_reject(module, action, "%d parameters are more than %d", (int)command->count, PARAMETERS_MAX);
        return true;
    }
    for (int n = 0; n < command->count; ++n) {
        bool good = is_name(command->parameters[n].name);
        for (int other = 0; good && other < n; ++other)
            good = strcmp(command->parameters[other].name, command->parameters[n].name) != 0;
        if (!good) {
            advee_action_reject(module, action, "a parameter has no valid name, or that of another one");
            return true;
        }
    }
    for (int n = 0; n < command->count; ++n)
        if (strnlen(command->parameters[n].value, VALUE_MAX + 1) > VALUE_MAX) {
            advee_action_reject(module, action, "the value of a parameter has more than %d bytes", VALUE_MAX);
            return true;
        }
    return false;
}

static void begin(advee_t *module, const offer_t *offer, const highlevel_cmd_action_t *command)
{
    const advee_action_t number = ++last_number;
    entry_t *action = &under_way[under_way_count++];
    memset(action, 0, sizeof *action);
    action->number = number;
    strcpy(action->id, command->id);
    action->offer = offer;
    action->status = HIGHLEVEL_DATA_ACTION_T_ACCEPTED;
    action->progress = NAN;
    action->published = -INFINITY;
    if (command->cancel) {
        advee_action_cancelled(module, number, "it was not under way");
        return;
    }
    if (objects(module, number, command))
        return;
    for (int n = 0; n < command->count; ++n)
        action->parameters[n] =
            (parameter_t){copied(command->parameters[n].name), copied(command->parameters[n].value)};
    action->parameter_count = command->count;
    offer->begin(module, number);
    entry_t *begun = find(number);
    if (begun && isinf(begun->published)) /* its work has begun without a report */
        publish_status(module, begun);
}

static void on_action(advee_t *module, const highlevel_cmd_action_t *command)
{
    if (!is_id(command->id)) {
        advee_fault(module, ADVEE_MESSAGE_MALFORMED, ADVEE_KIND_UNKNOWN, ADVEE_WARNING, "HL_CMD_ACTION",
                    "HL_CMD_ACTION: a command without a valid id is dropped");
        return;
    }
    entry_t *known = find_by_id(command->id);
    if (known) {
        const advee_action_t number = known->number;
        if (command->cancel && !over(known))
            cancel(module, number);
        known = find(number);
        if (known && advee_now() - known->published >= AGAIN)
            publish_status(module, known);
        return;
    }
    for (size_t n = 0; n < offer_count; ++n)
        if (strcmp(offers[n].name, command->name) == 0) {
            begin(module, &offers[n], command);
            return;
        }
}
ADVEE_HANDLER(highlevel_cmd_action_t, on_action)

static void repeat(advee_t *module)
{
    for (size_t n = 0; n < under_way_count; ++n)
        publish_status(module, &under_way[n]);
    for (size_t n = 0; n < ENDED_MAX; ++n)
        if (ended[n].ends > 0) {
            --ended[n].ends;
            publish_status(module, &ended[n]);
        }
}

/* When the module leaves RUN, what is under way has failed. */
static void before_state(advee_t *module, advee_state_t to)
{
    if (to == ADVEE_RUN)
        return;
    advee_action_t lasting[UNDER_WAY_MAX + 1];
    const size_t count = under_way_count;
    for (size_t n = 0; n < count; ++n)
        lasting[n] = under_way[n].number;
    for (size_t n = 0; n < count; ++n) {
        entry_t *action = find(lasting[n]);
        if (!action || over(action))
            continue;
        snprintf(action->lost, sizeof action->lost, "%s is in %s", advee_name(module), advee_state_name(to));
        cancel(module, lasting[n]);
        advee_action_cancelled(module, lasting[n], "%s", "");
    }
}

void advee_actions(advee_t *module)
{
    advee_before_state(module, before_state);
    ADVEE_SUBSCRIBE(module, "HL_CMD_ACTION", on_action);
    advee_every(module, PERIOD, repeat);
}

void advee_offer(advee_t *module, const char *name, void (*begin)(advee_t *, advee_action_t),
                 void (*cancel)(advee_t *, advee_action_t))
{
    if (!is_name(name) || offer_count == OFFERS_MAX) {
        fprintf(stderr, "%s: %s cannot be offered: it is no name of an action, or the %dth one\n", advee_name(module),
                name, OFFERS_MAX + 1);
        exit(ADVEE_OTHER);
    }
    offer_t *offer = &offers[offer_count++];
    strcpy(offer->name, name);
    offer->begin = begin;
    offer->cancel = cancel;
}
