/* The contract of a module, for modules in C on the official LCM (docs/writing-a-module.md).
 *
 *     static void on_power(advee_t *module, const lowlevel_data_power_t *power) { advee_working(module); }
 *     ADVEE_HANDLER(lowlevel_data_power_t, on_power)
 *
 *     int main(int argc, char **argv)
 *     {
 *         advee_options_t options = advee_options("watch", argc, argv);
 *         advee_t *module = advee_create(&options, NULL);
 *         ADVEE_SUBSCRIBE(module, "LL_DATA_POWER", on_power);
 *         return advee_run(module);
 *     }
 *
 * One loop serves the bus, timers and the module's own descriptors, and sends heartbeats; all handlers are called from
 * it and must return quickly: one that takes 200 ms is a hang. Around them the loop announces the state each second and
 * on change, obeys state commands by the table, reports each fault when it is raised and when it is cleared, lists the
 * active ones, and ends at TERMINATE, at SIGTERM, and when the watchdog that started it is gone without a successor.
 * Needs C11, Linux, the types of messages/common by the official lcm-gen, and liblcm 1.3.1 or later. The same in
 * other languages: advee.py, advee.hpp, Advee.cs, advee/Module.java. */
#pragma once

#include <lcm/lcm.h>
#include <stdbool.h>
#include <stdint.h>

/* Exit codes: a class plus a number 0 to 16. */
enum { ADVEE_RESOURCE = 0x10, ADVEE_DEVICE = 0x20, ADVEE_OTHER = 0x40 };
/* Fault numbers shared by all modules (docs/faults.md). A module's own numbers begin at 0x8001. */
enum { ADVEE_COMMAND_FORBIDDEN = 0x0001, ADVEE_MESSAGE_MALFORMED = 0x0002 };

/* The states of a module, types and severities of faults, by their values on the wire. */
typedef enum {
    ADVEE_UNKNOWN, ADVEE_INIT, ADVEE_STOP, ADVEE_RUN, ADVEE_ERROR, ADVEE_TERMINATE, ADVEE_PAUSE
} advee_state_t;
typedef enum { ADVEE_KIND_UNKNOWN, ADVEE_KIND_TIMEOUT, ADVEE_KIND_RESOURCE, ADVEE_KIND_DEVICE } advee_kind_t;
typedef enum { ADVEE_NOTICE, ADVEE_WARNING, ADVEE_SEVERE } advee_severity_t;

/* A module. */
typedef struct advee advee_t;

/* The command line of a module: --name, --state (RUN, PAUSE or STOP: the one after INIT) and --lcm-url; the other
 * arguments are counted and kept in `rest`. The watchdog passes the same by the environment variables ADVEE_MODULE,
 * ADVEE_STATE and LCM_DEFAULT_URL; arguments have priority. The texts are those of argv and of the environment. */
typedef struct {
    const char *name, *lcm_url;
    advee_state_t state;
    int rests;
    char **rest;
} advee_options_t;

/* Reads the command line. One that is invalid ends the process with ADVEE_RESOURCE. Moves the other arguments to the
 * front of argv. */
advee_options_t advee_options(const char *module, int argc, char **argv);

/* Prints the reason and exits with ADVEE_RESOURCE: the command line is invalid. */
_Noreturn void advee_refuse(const advee_options_t *options, const char *why, ...) __attribute__((format(printf, 2, 3)));

/* Creates the module, in INIT. `user` is what advee_user returns. Ends the process with ADVEE_RESOURCE if the bus
 * cannot be opened. At most one module for each process. */
advee_t *advee_create(const advee_options_t *options, void *user);

/* Runs until the module ends, frees it, and returns the exit code. No thread may use it afterwards. */
int advee_run(advee_t *module);

/* What advee_create was given. */
void *advee_user(const advee_t *module);

/* The bus, for the publish functions of lcm-gen: TYPE_publish(advee_bus(module), "CHANNEL", &message). */
lcm_t *advee_bus(advee_t *module);

/* The present state, and whether the module may act: only in RUN. */
advee_state_t advee_state(const advee_t *module);
bool advee_acts(const advee_t *module);

/* Has the handler called after a change of state has been announced. In TERMINATE it is the last call. */
void advee_on_state(advee_t *module, void (*handler)(advee_t *, advee_state_t));

/* Has the handler called before a change of state, for helpers on top of this one. */
void advee_before_state(advee_t *module, void (*handler)(advee_t *, advee_state_t));

/* Its name on the bus, and the name of a state. */
const char *advee_name(const advee_t *module);
const char *advee_state_name(advee_state_t state);

/* Has the handler called with this period; missed calls are dropped. */
void advee_every(advee_t *module, double seconds, void (*handler)(advee_t *));

/* Has the handler called when this descriptor is readable. */
void advee_watch(advee_t *module, int fd, void (*handler)(advee_t *));

/* Makes void handler(advee_t *, const TYPE *) one that ADVEE_SUBSCRIBE takes, for a TYPE of lcm-gen. */
#define ADVEE_HANDLER(type, handler)                                               \
    static bool handler##_decoded(advee_t *module, void *bytes, int size)          \
    {                                                                              \
        type message;                                                              \
        if (type##_decode(bytes, 0, size, &message) < 0)                           \
            return false;                                                          \
        handler(module, &message);                                                 \
        type##_decode_cleanup(&message);                                           \
        return true;                                                               \
    }

/* Calls the handler for each message. A message of another type is dropped and reported once. */
#define ADVEE_SUBSCRIBE(module, channel, handler) advee_subscribe(module, channel, handler##_decoded)

/* The same for a function that decodes by itself: false if the bytes are no message of its type. */
void advee_subscribe(advee_t *module, const char *channel, bool (*handler)(advee_t *, void *bytes, int size));

/* Reports the device as present: leads out of INIT, and out of ERROR to the previous state. May be repeated. */
void advee_working(advee_t *module);

/* Reports the device as lost: ERROR, until advee_working. Keep trying. May be repeated. */
void advee_failed(advee_t *module);

/* Raises a fault; reported once until advee_clear. The meaning of its number, 0x8001 or above, never changes; `subject`
 * ("" if there is one only) distinguishes faults of one number. Raised again, it is listed with the new severity and
 * text. */
#define advee_fault(module, number, kind, severity, subject, ...) \
    advee_fault_at(__FILE__, __LINE__, module, number, kind, severity, subject, __VA_ARGS__)
void advee_fault_at(const char *file, int line, advee_t *module, int number, advee_kind_t kind,
                    advee_severity_t severity, const char *subject, const char *text, ...)
    __attribute__((format(printf, 8, 9)));

/* Clears a fault; reported if it was active. */
#define advee_clear(module, number, subject, ...) \
    advee_clear_at(__FILE__, __LINE__, module, number, subject, __VA_ARGS__)
void advee_clear_at(const char *file, int line, advee_t *module, int number, const char *subject, const char *text, ...)
    __attribute__((format(printf, 6, 7)));

/* Reports a fatal error, and ends with this exit code; 0: that of the kind. The watchdog restarts the module. */
#define advee_fatal(module, number, kind, code, ...) \
    advee_fatal_at(__FILE__, __LINE__, module, number, kind, code, __VA_ARGS__)
void advee_fatal_at(const char *file, int line, advee_t *module, int number, advee_kind_t kind, int code,
                    const char *text, ...) __attribute__((format(printf, 7, 8)));

/* Ends the module in good order, as a TERMINATE command does. */
void advee_end(advee_t *module);

/* Monotonic time, s: for deadlines. */
double advee_now(void);

/* Current time for messages, µs since 1970; a step of the wall clock never turns it back. */
int64_t advee_timestamp(void);

/* The heartbeat of one thread. */
typedef struct {
    int page;
    uint32_t count;
    long place;
    double due;
} advee_beat_t;

/* Returns the heartbeat of the thread of that name, for use by that thread only. From this call on silence is a hang,
 * so make it when the thread's loop begins. At most 63 threads; the loop of advee_run is one of them. */
advee_beat_t advee_thread(advee_t *module, const char *name);

/* To be called in the thread's loop at least each 50 ms; does not block. */
void advee_beat(advee_beat_t *beat);
