/* Documented in advee.h. */
#define _GNU_SOURCE
#include "advee.h"

#include "common_cmd_level_t.h"
#include "common_cmd_state_t.h"
#include "common_data_faults_t.h"
#include "common_data_state_t.h"
#include "common_error_t.h"
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <time.h>
#include <unistd.h>

static const double ANNOUNCE = 1.0; /* s between two announcements */
static const double BEAT = 0.05;    /* s between two heartbeats */
static const double LOOK = 0.5;     /* s between two checks for the watchdog */
enum {
    ORPHANED = 6,     /* checks without CM_DATA_PROCESSES: the watchdog is gone, without a successor */
    FAULTS_MAX = 256, /* active faults in a list; further ones are not reported */
    TEXT_MAX = 512,   /* bytes of a subject or a message in a list */
    BURST = 64,       /* messages per cycle of the loop, so that a flood delays nothing else for long */
    THREADS_MAX = 63,
    LEVEL_DEBUG = 0, /* lowest and highest level; a severity is of the level above its value */
    LEVEL_ERROR = 3,
};
static const double REFUSALS = 1.0; /* s at least between two reports of refused commands for the levels */

/* An active fault: as it was last raised, and the time when it was first raised. */
typedef struct {
    int number;
    advee_kind_t kind;
    advee_severity_t severity;
    int64_t since;
    bool sent; /* its begin was reported, so its end will be */
    char *subject, *message;
} fault_t;

typedef struct {
    double due, period;
    void (*handler)(advee_t *);
} timer_entry_t;

typedef struct {
    advee_t *module;
    bool (*handler)(advee_t *, void *, int);
} channel_t;

struct advee {
    char *name;
    void *user;
    lcm_t *bus;
    advee_state_t state, before_error, wanted;
    void (*on_state)(advee_t *, advee_state_t), (*before_state)(advee_t *, advee_state_t);
    bool lost;    /* last report of the module about its device */
    int send_from; /* level from which reports are sent */
    unsigned refused; /* commands for the levels since the last report of one */
    double refusal;   /* s; time of that report */
    int unheard;  /* checks since the last message of the watchdog */
    int code;     /* 0 or above: the module ends with this code */
    int signals;  /* descriptor */
    timer_entry_t *timers;
    size_t timer_count;
    struct pollfd *polled;
    void (**polled_by)(advee_t *);
    size_t polled_count;
    channel_t **channels;
    size_t channel_count;
    fault_t faults[FAULTS_MAX];
    size_t fault_count;
    int page; /* of heartbeats; -1: none */
    int threads;
    pthread_mutex_t page_lock;
};

/* --- small things --- */

static void *checked(void *memory)
{
    if (!memory) {
        fputs("out of memory\n", stderr);
        exit(ADVEE_RESOURCE);
    }
    return memory;
}

/* One more place in an array. */
static void *grown(void *array, size_t count, size_t size)
{
    return checked(realloc(array, (count + 1) * size));
}

/* A text of its own. */
static char *formatted(const char *text, va_list arguments)
{
    char *made = NULL;
    if (vasprintf(&made, text, arguments) < 0)
        made = NULL;
    return checked(made);
}

/* Truncates a text to the maximum length in a list; characters are never split. */
static char *clipped(char *text)
{
    size_t end = strlen(text);
    if (end > TEXT_MAX)
        for (end = TEXT_MAX; end > 0 && ((unsigned char)text[end] & 0xC0) == 0x80;)
            --end;
    text[end] = 0;
    return text;
}

static double seconds_of(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static int64_t micros_of(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return (int64_t)time.tv_sec * 1000000 + time.tv_nsec / 1000;
}

double advee_now(void)
{
    return seconds_of(CLOCK_MONOTONIC);
}

static int64_t epoch;

static void read_epoch(void)
{
    epoch = micros_of(CLOCK_REALTIME) - micros_of(CLOCK_MONOTONIC);
}

int64_t advee_timestamp(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, read_epoch);
    return epoch + micros_of(CLOCK_MONOTONIC);
}

const char *advee_state_name(advee_state_t state)
{
    static const char *const names[] = {"UNKNOWN", "INIT", "STOP", "RUN", "ERROR", "TERMINATE", "PAUSE"};
    return names[state];
}

/* --- command line --- */

static const char *variable(const char *key, const char *otherwise)
{
    const char *value = getenv(key);
    return value && *value ? value : otherwise;
}

void advee_refuse(const advee_options_t *options, const char *why, ...)
{
    va_list arguments;
    va_start(arguments, why);
    char *text = formatted(why, arguments);
    va_end(arguments);
    fprintf(stderr, "%s: %s\n", options->name, text);
    exit(ADVEE_RESOURCE);
}

advee_options_t advee_options(const char *module, int argc, char **argv)
{
    const char *first = variable("ADVEE_STATE", "RUN");
    advee_options_t options = {
        .name = variable("ADVEE_MODULE", module),
        .lcm_url = variable("LCM_DEFAULT_URL", "udpm://239.255.76.67:7667?ttl=0"),
        .rest = argv,
    };
    for (int n = 1; n < argc; ++n) {
        const char *const known[] = {"--name", "--state", "--lcm-url"};
        const char **const values[] = {&options.name, &first, &options.lcm_url};
        int option = 0;
        while (option < 3 && strcmp(argv[n], known[option]) != 0)
            ++option;
        if (option == 3)
            options.rest[options.rests++] = argv[n];
        else if (++n < argc)
            *values[option] = argv[n];
        else
            advee_refuse(&options, "%s needs a value", known[option]);
    }
    if (strcmp(first, "RUN") == 0)
        options.state = ADVEE_RUN;
    else if (strcmp(first, "PAUSE") == 0)
        options.state = ADVEE_PAUSE;
    else if (strcmp(first, "STOP") == 0)
        options.state = ADVEE_STOP;
    else
        advee_refuse(&options, "--state %s: expected RUN, PAUSE or STOP", first);
    return options;
}

/* --- heartbeats (docs/beats.md) --- */

static void put_u32(uint8_t *to, uint32_t value)
{
    for (int n = 0; n < 4; ++n)
        to[n] = (uint8_t)(value >> 8 * n);
}

advee_beat_t advee_thread(advee_t *module, const char *name)
{
    advee_beat_t beat = {.page = -1};
    if (module->page < 0)
        return beat;
    pthread_mutex_lock(&module->page_lock);
    if (module->threads < THREADS_MAX) {
        const long place = 64 + 64 * module->threads++;
        uint8_t entry[64] = {0}, head[16] = {'B', 'E', 'A', 'T', 1};
        memcpy(entry, name, strnlen(name, 48));
        entry[48] = 1;
        put_u32(head + 8, (uint32_t)getpid());
        put_u32(head + 12, (uint32_t)module->threads);
        /* The number of threads last: an entry counts when it is complete. */
        if (pwrite(module->page, entry, sizeof entry, place) < 0 || pwrite(module->page, head, sizeof head, 0) < 0)
            perror("page of beats");
        beat = (advee_beat_t){.page = module->page, .count = 1, .place = place + 48, .due = advee_now() + BEAT};
    }
    pthread_mutex_unlock(&module->page_lock);
    return beat;
}

void advee_beat(advee_beat_t *beat)
{
    if (beat->page < 0 || advee_now() < beat->due)
        return;
    beat->due = advee_now() + BEAT;
    uint8_t bytes[4];
    put_u32(bytes, ++beat->count);
    /* A failed write is a missing heartbeat, which the watchdog detects. */
    if (pwrite(beat->page, bytes, sizeof bytes, beat->place) < 0)
        return;
}

/* --- what the module says --- */

static void announce(advee_t *module)
{
    common_data_state_t message = {
        .timestamp = advee_timestamp(), .module = module->name, .state = (int8_t)module->state};
    common_data_state_t_publish(module->bus, "CM_DATA_STATE", &message);
}

/* Publishes the active faults, before the report of the same moment, so that its subject is known. */
static void list(advee_t *module, int64_t at)
{
    common_fault_t faults[FAULTS_MAX];
    for (size_t n = 0; n < module->fault_count; ++n) {
        const fault_t *fault = &module->faults[n];
        faults[n] = (common_fault_t){
            .number = fault->number,
            .subject = fault->subject,
            .severity = (int8_t)fault->severity,
            .since = fault->since,
            .message = fault->message,
        };
    }
    common_data_faults_t message = {
        .timestamp = at, .module = module->name, .count = (int32_t)module->fault_count, .faults = faults};
    common_data_faults_t_publish(module->bus, "CM_DATA_FAULTS", &message);
}

typedef struct {
    const char *file;
    int line;
} source_t;

static void report(advee_t *module, source_t source, int number, advee_kind_t kind, advee_severity_t severity,
                   char *text, int64_t at, bool fatal)
{
    const char *base = strrchr(source.file, '/');
    common_error_t message = {
        .timestamp = at,
        .module = module->name,
        .number = number,
        .message = text,
        .fatal = fatal,
        .type = (int8_t)kind,
        .severity = (int8_t)severity,
        .file = (char *)(base ? base + 1 : source.file),
        .line = source.line,
    };
    common_error_t_publish(module->bus, "CM_EVENT_ERROR", &message);
}

/* True if reports of this severity are sent. */
static bool sends(const advee_t *module, advee_severity_t severity)
{
    return (int)severity + 1 >= module->send_from;
}

static fault_t *active(advee_t *module, int number, const char *subject)
{
    for (size_t n = 0; n < module->fault_count; ++n)
        if (module->faults[n].number == number && strcmp(module->faults[n].subject, subject) == 0)
            return &module->faults[n];
    return NULL;
}

void advee_fault_at(const char *file, int line, advee_t *module, int number, advee_kind_t kind,
                    advee_severity_t severity, const char *subject, const char *text, ...)
{
    char *own = clipped(checked(strdup(subject)));
    va_list arguments;
    va_start(arguments, text);
    char *message = formatted(text, arguments);
    va_end(arguments);
    const int64_t now = advee_timestamp();
    fault_t *known = active(module, number, own);
    if (known) {
        const bool news = known->severity != severity;
        free(known->message);
        free(own);
        known->severity = severity;
        known->message = clipped(message);
        if (news)
            list(module, now);
    } else if (module->fault_count < FAULTS_MAX) {
        char *whole = checked(strdup(message));
        const bool sent = sends(module, severity);
        module->faults[module->fault_count++] = (fault_t){number, kind, severity, now, sent, own, clipped(message)};
        list(module, now);
        if (sent)
            report(module, (source_t){file, line}, number, kind, severity, whole, now, false);
        free(whole);
    } else {
        free(own);
        free(message);
    }
}

void advee_clear_at(const char *file, int line, advee_t *module, int number, const char *subject, const char *text, ...)
{
    char *own = clipped(checked(strdup(subject)));
    fault_t *known = active(module, number, own);
    free(own);
    if (!known)
        return;
    const advee_kind_t kind = known->kind;
    const bool sent = known->sent;
    free(known->subject);
    free(known->message);
    *known = module->faults[--module->fault_count];
    va_list arguments;
    va_start(arguments, text);
    char *message = formatted(text, arguments);
    va_end(arguments);
    const int64_t now = advee_timestamp();
    list(module, now);
    if (sent)
        report(module, (source_t){file, line}, number, kind, ADVEE_NOTICE, message, now, false);
    free(message);
}

void advee_fatal_at(const char *file, int line, advee_t *module, int number, advee_kind_t kind, int code,
                    const char *text, ...)
{
    va_list arguments;
    va_start(arguments, text);
    char *message = formatted(text, arguments);
    va_end(arguments);
    report(module, (source_t){file, line}, number, kind, ADVEE_SEVERE, message, advee_timestamp(), true);
    free(message);
    if (code != 0)
        module->code = code;
    else if (kind == ADVEE_KIND_RESOURCE)
        module->code = ADVEE_RESOURCE;
    else
        module->code = kind == ADVEE_KIND_DEVICE ? ADVEE_DEVICE : ADVEE_OTHER;
}

/* --- states --- */

static void enter(advee_t *module, advee_state_t to)
{
    if (module->before_state)
        module->before_state(module, to);
    module->state = to;
    announce(module);
    if (module->on_state)
        module->on_state(module, to);
}

void advee_working(advee_t *module)
{
    module->lost = false;
    if (module->state == ADVEE_ERROR && module->before_error != ADVEE_INIT)
        enter(module, module->before_error);
    else if (module->state == ADVEE_INIT || module->state == ADVEE_ERROR)
        enter(module, module->wanted);
}

void advee_failed(advee_t *module)
{
    module->lost = true;
    if (module->state == ADVEE_ERROR || module->state == ADVEE_TERMINATE)
        return;
    module->before_error = module->state;
    enter(module, ADVEE_ERROR);
}

void advee_end(advee_t *module)
{
    if (module->state == ADVEE_TERMINATE)
        return;
    enter(module, ADVEE_TERMINATE);
    if (module->code < 0)
        module->code = 0;
}

/* True if the table allows a command from one state to another; without TERMINATE. */
static bool allows(advee_state_t from, advee_state_t to, bool manual)
{
    switch (to) {
    case ADVEE_RUN: return from == ADVEE_PAUSE || (from == ADVEE_STOP && manual);
    case ADVEE_PAUSE: return from == ADVEE_RUN || (from == ADVEE_STOP && manual);
    case ADVEE_STOP: return manual;
    default: return false;
    }
}

/* Reports a command that is refused. */
static void refused(advee_t *module, int line, const char *text, ...)
{
    va_list arguments;
    va_start(arguments, text);
    char *message = formatted(text, arguments);
    va_end(arguments);
    if (sends(module, ADVEE_WARNING))
        report(module, (source_t){__FILE__, line}, ADVEE_COMMAND_FORBIDDEN, ADVEE_KIND_UNKNOWN, ADVEE_WARNING, message,
               advee_timestamp(), false);
    free(message);
}

static void obey(advee_t *module, const common_cmd_state_t *command)
{
    const bool to_us = strcmp(command->module, module->name) == 0 || strcmp(command->module, "*") == 0;
    if (!to_us || command->state == (int8_t)module->state || module->state == ADVEE_TERMINATE)
        return;
    if (command->state < 0 || command->state > ADVEE_PAUSE) {
        refused(module, __LINE__, "command from %s refused: %d is no state", command->source, command->state);
        return;
    }
    const advee_state_t to = (advee_state_t)command->state;
    if (to == ADVEE_TERMINATE) {
        advee_end(module);
    } else if (allows(module->state, to, command->manual)) {
        if (module->state == ADVEE_INIT)
            module->wanted = to;
        enter(module, to);
        /* A command led it through STOP out of ERROR; its device is still lost. */
        if (module->lost && (module->state == ADVEE_RUN || module->state == ADVEE_PAUSE))
            advee_failed(module);
    } else {
        refused(module, __LINE__, "%scommand %s from %s refused in %s", command->manual ? "manual " : "",
                advee_state_name(to), command->source, advee_state_name(module->state));
    }
}
ADVEE_HANDLER(common_cmd_state_t, obey)

static bool is_level(int value)
{
    return (value >= LEVEL_DEBUG && value <= LEVEL_ERROR) || value == COMMON_CMD_LEVEL_T_UNCHANGED ||
           value == COMMON_CMD_LEVEL_T_CONFIGURED;
}

/* Obeys a command for the level from which reports are sent. Its watchdog prints and sends its lines, and answers. A
 * flood of refused commands is one report each second. */
static void set_level(advee_t *module, const common_cmd_level_t *command)
{
    if (strcmp(command->module, module->name) != 0 && strcmp(command->module, "*") != 0)
        return;
    if (is_level(command->print_from) && is_level(command->send_from)) {
        if (command->send_from == COMMON_CMD_LEVEL_T_CONFIGURED)
            module->send_from = LEVEL_DEBUG;
        else if (command->send_from != COMMON_CMD_LEVEL_T_UNCHANGED)
            module->send_from = command->send_from;
        return;
    }
    ++module->refused;
    const double now = advee_now();
    if (now - module->refusal < REFUSALS)
        return;
    const int value = is_level(command->print_from) ? command->send_from : command->print_from;
    char more[64] = "";
    if (module->refused > 1)
        snprintf(more, sizeof more, "; %u refused since the last report", module->refused);
    module->refused = 0;
    module->refusal = now;
    refused(module, __LINE__, "command from %s refused: %d is no level%s", command->source, value, more);
}
ADVEE_HANDLER(common_cmd_level_t, set_level)

static bool on_watchdog(advee_t *module, void *bytes, int size)
{
    (void)bytes, (void)size;
    module->unheard = 0;
    return true;
}

static void look_for_watchdog(advee_t *module)
{
    /* Checks are counted, not seconds: a delayed process checks once, and then receives the queued messages. */
    if (++module->unheard <= ORPHANED)
        return;
    fprintf(stderr, "%s: the watchdog is gone: it ends\n", module->name);
    advee_end(module);
}

/* --- the loop --- */

static void on_message(const lcm_recv_buf_t *received, const char *name, void *user)
{
    channel_t *channel = user;
    if (!channel->handler(channel->module, received->data, (int)received->data_size))
        advee_fault(channel->module, ADVEE_MESSAGE_MALFORMED, ADVEE_KIND_UNKNOWN, ADVEE_WARNING, name,
                    "%s: a message of %u bytes is dropped", name, (unsigned)received->data_size);
}

void advee_subscribe(advee_t *module, const char *channel, bool (*handler)(advee_t *, void *, int))
{
    channel_t *entry = checked(malloc(sizeof *entry));
    *entry = (channel_t){module, handler};
    module->channels = grown(module->channels, module->channel_count, sizeof *module->channels);
    module->channels[module->channel_count++] = entry;
    lcm_subscription_set_queue_capacity(lcm_subscribe(module->bus, channel, on_message, entry), BURST);
}

void advee_every(advee_t *module, double seconds, void (*handler)(advee_t *))
{
    module->timers = grown(module->timers, module->timer_count, sizeof *module->timers);
    module->timers[module->timer_count++] = (timer_entry_t){advee_now() + seconds, seconds, handler};
}

void advee_watch(advee_t *module, int fd, void (*handler)(advee_t *))
{
    module->polled = grown(module->polled, module->polled_count, sizeof *module->polled);
    module->polled_by = grown(module->polled_by, module->polled_count, sizeof *module->polled_by);
    module->polled_by[module->polled_count] = handler;
    module->polled[module->polled_count++] = (struct pollfd){.fd = fd, .events = POLLIN};
}

static void on_bus(advee_t *module)
{
    for (int n = 0; n < BURST && module->code < 0 && lcm_handle_timeout(module->bus, 0) > 0; ++n)
        ;
}

static void announce_all(advee_t *module)
{
    announce(module);
    list(module, advee_timestamp());
}

static void serve_timers(advee_t *module)
{
    /* A handler may add one. */
    for (size_t n = 0; n < module->timer_count && module->code < 0; ++n) {
        timer_entry_t *timer = &module->timers[n];
        const double late = advee_now() - timer->due;
        if (late < 0)
            continue;
        timer->due += timer->period * (1 + floor(late / timer->period));
        timer->handler(module);
    }
}

static void wait_for_input(advee_t *module)
{
    double wait = module->page < 0 ? ANNOUNCE : BEAT;
    for (size_t n = 0; n < module->timer_count; ++n)
        wait = fmin(wait, module->timers[n].due - advee_now());
    const size_t count = module->polled_count;
    if (poll(module->polled, count, (int)ceil(1000 * fmax(0, wait))) <= 0)
        return;
    /* A handler may add to both lists. */
    for (size_t n = 0; n < count && module->code < 0; ++n)
        if (module->polled[n].revents)
            module->polled_by[n](module);
}

static int asked_to_end(void)
{
    sigset_t asked;
    sigemptyset(&asked);
    sigaddset(&asked, SIGTERM);
    sigaddset(&asked, SIGINT);
    pthread_sigmask(SIG_BLOCK, &asked, NULL);
    return signalfd(-1, &asked, SFD_CLOEXEC | SFD_NONBLOCK);
}

advee_t *advee_create(const advee_options_t *options, void *user)
{
    advee_t *module = checked(calloc(1, sizeof *module));
    module->name = checked(strdup(options->name));
    module->user = user;
    module->state = module->before_error = ADVEE_INIT;
    module->wanted = options->state;
    module->code = module->page = -1;
    module->send_from = LEVEL_DEBUG;
    module->refusal = -REFUSALS;
    pthread_mutex_init(&module->page_lock, NULL);
    /* Before any thread is started, as LCM does: all threads inherit the mask. */
    module->signals = asked_to_end();
    module->bus = lcm_create(options->lcm_url);
    if (!module->bus)
        advee_refuse(options, "LCM at %s cannot be had", options->lcm_url);
    const char *path = variable("ADVEE_BEATS", NULL);
    if (path && (module->page = open(path, O_WRONLY | O_NOFOLLOW | O_CLOEXEC)) < 0)
        fprintf(stderr, "no page of beats: %s: %s\n", path, strerror(errno));
    ADVEE_SUBSCRIBE(module, "CM_CMD_STATE", obey);
    ADVEE_SUBSCRIBE(module, "CM_CMD_LEVEL", set_level);
    advee_watch(module, lcm_get_fileno(module->bus), on_bus);
    advee_watch(module, module->signals, advee_end);
    if (getenv("ADVEE_GUARDED")) { /* a watchdog has started us */
        advee_subscribe(module, "CM_DATA_PROCESSES", on_watchdog);
        advee_every(module, LOOK, look_for_watchdog);
    }
    return module;
}

static void destroy(advee_t *module)
{
    lcm_destroy(module->bus);
    for (size_t n = 0; n < module->channel_count; ++n)
        free(module->channels[n]);
    for (size_t n = 0; n < module->fault_count; ++n) {
        free(module->faults[n].subject);
        free(module->faults[n].message);
    }
    if (module->page >= 0)
        close(module->page);
    close(module->signals);
    pthread_mutex_destroy(&module->page_lock);
    free(module->channels);
    free(module->timers);
    free(module->polled);
    free(module->polled_by);
    free(module->name);
    free(module);
}

int advee_run(advee_t *module)
{
    announce_all(module);
    advee_every(module, ANNOUNCE, announce_all);
    advee_beat_t beat = advee_thread(module, "main");
    while (module->code < 0) {
        advee_beat(&beat);
        serve_timers(module);
        if (module->code < 0)
            wait_for_input(module);
    }
    const int code = module->code;
    destroy(module);
    return code;
}

void *advee_user(const advee_t *module)
{
    return module->user;
}

lcm_t *advee_bus(advee_t *module)
{
    return module->bus;
}

advee_state_t advee_state(const advee_t *module)
{
    return module->state;
}

bool advee_acts(const advee_t *module)
{
    return module->state == ADVEE_RUN;
}

void advee_on_state(advee_t *module, void (*handler)(advee_t *, advee_state_t))
{
    module->on_state = handler;
}

void advee_before_state(advee_t *module, void (*handler)(advee_t *, advee_state_t))
{
    module->before_state = handler;
}

const char *advee_name(const advee_t *module)
{
    return module->name;
}
