/* Reports a low battery voltage, long before the charge is near the reserve: a weak cell shows under load.
 *
 *     battery_watch [--below VOLTS]        report below this voltage [25]
 *
 * A module in C: docs/writing-a-module.md. Its device is LL_DATA_POWER. */
#include "advee.h"

#include "lowlevel_data_power_t.h"
#include <stdlib.h>
#include <string.h>

static const double MARGIN = 0.5; /* V above the limit: clears the fault */
static const double SILENT = 3.0; /* s; the power controller is polled each second */
enum { POWER_SILENT = 0x8001, BATTERY_SAGS = 0x8002 };

typedef struct {
    double below; /* V */
    double heard; /* s */
} watch_t;

static void on_power(advee_t *module, const lowlevel_data_power_t *power)
{
    watch_t *watch = advee_user(module);
    watch->heard = advee_now();
    advee_clear(module, POWER_SILENT, "", "LL_DATA_POWER is heard again");
    advee_working(module);
    if (!advee_acts(module))
        return;
    if (power->voltage < watch->below)
        advee_fault(module, BATTERY_SAGS, ADVEE_KIND_RESOURCE, ADVEE_WARNING, "",
                    "the battery has %.1f V, less than %.1f V", power->voltage, watch->below);
    else if (power->voltage >= watch->below + MARGIN)
        advee_clear(module, BATTERY_SAGS, "", "the battery has %.1f V again", power->voltage);
}
ADVEE_HANDLER(lowlevel_data_power_t, on_power)

static void on_look(advee_t *module)
{
    const watch_t *watch = advee_user(module);
    if (advee_now() - watch->heard < SILENT)
        return;
    advee_fault(module, POWER_SILENT, ADVEE_KIND_TIMEOUT, ADVEE_SEVERE, "",
                "no LL_DATA_POWER: is driver_power there?");
    advee_failed(module);
}

int main(int argc, char **argv)
{
    advee_options_t options = advee_options("battery_watch", argc, argv);
    watch_t watch = {.below = 25.0};
    for (int n = 0; n < options.rests; ++n) {
        char *end = NULL;
        if (strcmp(options.rest[n], "--below") != 0)
            advee_refuse(&options, "%s: expected --below VOLTS", options.rest[n]);
        if (++n == options.rests || (watch.below = strtod(options.rest[n], &end), end == options.rest[n] || *end))
            advee_refuse(&options, "--below needs a number of volts");
    }
    advee_t *module = advee_create(&options, &watch);
    watch.heard = advee_now();
    ADVEE_SUBSCRIBE(module, "LL_DATA_POWER", on_power);
    advee_every(module, 0.2, on_look);
    return advee_run(module);
}
