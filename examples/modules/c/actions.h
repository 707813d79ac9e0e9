/* Actions that a module in C offers: HL_CMD_ACTION and HL_DATA_ACTION (docs/highlevel.md); actions.py in C.
 *
 *     static void on_greet(advee_t *module, advee_action_t action)
 *     {
 *         const char *name = advee_action_text(module, action, "name", "visitor");
 *         advee_action_succeed(module, action, "greeted %s", name);
 *     }
 *
 *     advee_actions(module);
 *     advee_offer(module, "greet", on_greet, NULL);
 *
 * The helper answers each command, rejects those beyond the limits and those that come while the module is not in RUN,
 * repeats the status each second, knows repeated commands by their id, and fails what is under way when the module
 * leaves RUN. All calls come from the module's loop, and all functions are called from it. All memory is bounded: 16
 * actions under way, each with at most 32 parameters of 4 KiB, and the ids and messages of 64 that have ended. */
#pragma once

#include "advee.h"

/* An action that was commanded: a number, never used for another one; 0 is none. A number whose action is no longer
 * known is valid in all functions: it has ended, has no parameters, and nothing changes it. */
typedef uint64_t advee_action_t;

/* Begins to offer actions, once, after advee_create. */
void advee_actions(advee_t *module);

/* Offers the action of this name. `begin` is called for each one, in RUN: it starts the work, or rejects it, and
 * returns quickly; run reports progress, succeed, fail or cancelled its end, then or later. `cancel` is called once
 * when it is cancelled, and when the module leaves RUN: what is under way is stopped, and cancelled called as soon as
 * it is; if `cancel` is NULL that is at once. An invalid name ends the process with ADVEE_OTHER. */
void advee_offer(advee_t *module, const char *name, void (*begin)(advee_t *, advee_action_t),
                 void (*cancel)(advee_t *, advee_action_t));

/* Its id and name; "" if it is no longer known. The texts are valid until the next call of the loop. */
const char *advee_action_id(advee_t *module, advee_action_t action);
const char *advee_action_name(advee_t *module, advee_action_t action);

/* True once it has ended. */
bool advee_action_over(advee_t *module, advee_action_t action);

/* Returns a parameter, or the default; without both the action is rejected, and the result is NULL. The text is valid
 * until the action ends. */
const char *advee_action_text(advee_t *module, advee_action_t action, const char *key, const char *otherwise);

/* Stores a parameter as a number from low to high, or the default, which needs no limits. Else, and without a default
 * (NAN), the action is rejected, and the result is false. */
bool advee_action_number(advee_t *module, advee_action_t action, const char *key, double low, double high,
                         double otherwise, double *value);

/* Rejects it, with a reason; after its start it has failed. */
void advee_action_reject(advee_t *module, advee_action_t action, const char *why, ...)
    __attribute__((format(printf, 3, 4)));

/* Reports that it is under way: progress 0 to 1, or NAN if that is not known; what is done now. May be called at any
 * rate. */
void advee_action_run(advee_t *module, advee_action_t action, double progress, const char *message, ...)
    __attribute__((format(printf, 4, 5)));

/* Ends it: it has reached its aim; it has not, for this reason; it was cancelled, which counts as failed where that was
 * because the module left RUN. Later calls have no effect. */
void advee_action_succeed(advee_t *module, advee_action_t action, const char *message, ...)
    __attribute__((format(printf, 3, 4)));
void advee_action_fail(advee_t *module, advee_action_t action, const char *why, ...)
    __attribute__((format(printf, 3, 4)));
void advee_action_cancelled(advee_t *module, advee_action_t action, const char *message, ...)
    __attribute__((format(printf, 3, 4)));
