/* Module that fails in every way that the helper must handle, selected by its argument. C has no exceptions. */
#define _GNU_SOURCE
#include "advee.h"

#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

typedef struct {
    const char *how;
    atomic_bool hangs;
} broken_t;

static void on_tick(advee_t *module)
{
    const broken_t *broken = advee_user(module);
    advee_working(module);
    if (strcmp(broken->how, "device") == 0)
        advee_fatal(module, 0x8001, ADVEE_KIND_DEVICE, ADVEE_DEVICE + 3, "the device burns");
}

static void on_state(advee_t *module, advee_state_t state)
{
    broken_t *broken = advee_user(module);
    broken->hangs = state == ADVEE_PAUSE;
}

/* Sends heartbeats except in PAUSE, where it waits for an event that never comes. */
static void *work(void *module)
{
    const broken_t *broken = advee_user(module);
    advee_beat_t beat = advee_thread(module, "worker");
    for (;; usleep(10000))
        if (!broken->hangs)
            advee_beat(&beat);
    return NULL;
}

int main(int argc, char **argv)
{
    advee_options_t options = advee_options("broken_c", argc, argv);
    if (options.rests != 1)
        advee_refuse(&options, "expected one argument");
    /* The worker outlives main. */
    static broken_t broken;
    broken.how = options.rest[0];
    advee_t *module = advee_create(&options, &broken);
    advee_on_state(module, on_state);
    advee_every(module, 0.01, on_tick);
    if (strcmp(broken.how, "worker") == 0) {
        pthread_t worker;
        pthread_create(&worker, NULL, work, module);
        pthread_detach(worker);
    }
    return advee_run(module);
}
