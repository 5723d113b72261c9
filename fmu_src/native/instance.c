/* One instance of the FMU, whatever the version of FMI: what slave.py is to the Python FMU.
 *
 * model.c comes before: the tables of variables, effects and messages, and the model's text.  So do
 * two words of the FMI version: NUMBER, what it calls a double, and LAST_REFERENCE.
 * Every function that can be refused returns 1, or 0 after it has told why.  After a failure only
 * a reset or a restored state helps: an instance that went on with the old value of a refused
 * input would give wrong numbers.  There are no globals, so instances may run in threads.
 */
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* Rounding allowed in a master's clock, relative to 1 s or to the time; but never half a step, which
 * would let a step be repeated or left out. */
#define SLACK 1e-9
/* Internal steps in a communication step: what is longer never ends. */
#define MOST_SUB_STEPS 1000000
/* Distance from time 0, in internal steps: beyond it numbers lie more than the shortest sub-step of
 * 1/128 apart, and a sub-step would end where it began. */
#define FURTHEST 0x1p45
/* Step of a difference quotient, in sizes of the variable, and what two one-sided ones may differ
 * by where a model is smooth, relative. */
#define DIFFERENCE 0x1p-20
#define SMOOTH 1e-3
/* Rounding of an output, relative to its size. */
#define ROUNDING 1e-13
#define MESSAGE 512
#define FIRST_PARAMETER (INPUTS + OUTPUTS)

static const char *const categories[] = {"logStatusError", "logStatusWarning", "logAll"};
enum { CATEGORIES = sizeof categories / sizeof *categories };

typedef enum { INSTANTIATED, INITIALISING, RUNNING, TERMINATED } Phase;

/* Where an instance is in the state machine of FMI, as messages say it. */
static const char *const phases[] = {
    "before initialisation", "in initialisation", "between communication steps",
    "after termination"};

/* Everything that the next step depends on; a saved state is a copy of it. */
typedef struct {
    double begins;
    double last;
    double time;             /* that the last step reached; NaN before the run and after a failure */
    double values[VARIABLES]; /* by value reference: inputs, outputs, parameters */
    double x[SIZE];
    int32_t phase;
    int32_t has_x;
    int32_t off[EFFECTS + 1]; /* effects that were neutral when the parameters were last used */
    int32_t warned[NOTICES + CHECKED + 1]; /* whether of each notice, and of each input */
    char trouble[MESSAGE];    /* what has failed, until reset or a restored state */
} State;

typedef struct {
    char magic[8];
    char identity[64];
    uint64_t bytes;
    double one; /* in the byte order of the machine */
    uint64_t digest;
} Header;

typedef struct {
    Header header;
    State state;
} Saved;

typedef void Tell(void *host, int is_warning, const char *message);

typedef struct {
    State now;
    Setup setup;
    int stale;      /* parameters (until the run begins: inputs too) have changed since prepare */
    double longest;  /* communication step [s] */
    double furthest; /* end of a step from time 0 [s] */
    Tell *tell;
    void *host;
} Instance;

/* ---- what goes wrong -------------------------------------------------------------------- */

static int refuse(Instance *I, const char *format, ...);
static int fail(Instance *I, const char *format, ...);

static void say(Instance *I, int is_warning, const char *message)
{
    if (I->tell)
        I->tell(I->host, is_warning, message);
}

/* Tell the host and leave the instance as it is. */
static int refuse(Instance *I, const char *format, ...)
{
    char message[MESSAGE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    say(I, 0, message);
    return 0;
}

/* Let nothing follow but a reset or a restored state. */
static int fail(Instance *I, const char *format, ...)
{
    char message[MESSAGE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    I->now.time = NAN;
    if (!I->now.trouble[0]) /* no stray bytes of the stack: they would be saved */
        memcpy(I->now.trouble, message, strlen(message) + 1);
    say(I, 0, message);
    return 0;
}

/* Whether every name is that of a log category. */
static int are_categories(Instance *I, const char *const *names, size_t count)
{
    size_t i;
    int k;
    for (i = 0; i < count; i++) {
        for (k = 0; k < CATEGORIES; k++)
            if (names[i] && strcmp(names[i], categories[k]) == 0)
                break;
        if (k == CATEGORIES)
            return refuse(I, "no log category '%.100s': there are logStatusError,"
                          " logStatusWarning and logAll",
                          names[i] ? names[i] : "NULL");
    }
    return 1;
}

static int is_finite(double value)
{
    return fabs(value) <= MOST;
}

/* Whether an instance has not failed; "call" is what the host asks for. */
static int sound(Instance *I, const char *call)
{
    if (I->now.trouble[0])
        return refuse(I, "%s after a failure (%.300s): reset or restore a state first", call,
                      I->now.trouble);
    return 1;
}

static int only(Instance *I, const char *call, Phase phase)
{
    if (!sound(I, call))
        return 0;
    if (I->now.phase != (int32_t)phase)
        return fail(I, "%s %s: it belongs %s", call, phases[I->now.phase], phases[phase]);
    return 1;
}

static int begun(const Instance *I)
{
    return I->now.phase == RUNNING || I->now.phase == TERMINATED;
}

/* ---- the model -------------------------------------------------------------------------- */

static int explain_code(Instance *I, int code, const double *x, double time)
{
    if (code == ARITHMETIC)
        return fail(I, "arithmetic fails in the step to t = %g s: a parameter or the internal step"
                       " is too large", time);
    if (code < 0)
        return fail(I, "%s, at t = %g s", faults[-1 - code], time);
    if (code == TOO_FAST && x[0] > 0.0)
        return fail(I, "the parameters make '" MODEL "' too fast for its internal step: it needs"
                       " internal_step = %.1g s or less; give that if its bounds allow, or slower"
                       " parameters, at t = %g s", x[0], time);
    if (code == TOO_FAST)
        return fail(I, "the parameters make '" MODEL "' too fast for its internal step: none will"
                       " do; give slower parameters, at t = %g s", time);
    if (code <= STATES)
        return fail(I, "state '%s' is not finite; a parameter or the internal step is too large,"
                       " at t = %g s", states[code - 1], time);
    return fail(I, "output '%s' is not finite; a parameter or the internal step is too large,"
                   " at t = %g s", variables[INPUTS + code - 1 - STATES].name, time);
}

/* Step x and keep the outputs; a size of 0 only looks at them. */
static int advance(Instance *I, double *x, double time, double size)
{
    const int code = step(&I->setup, x, I->now.values, time, size, I->now.values + INPUTS);
    return code ? explain_code(I, code, x, time + size) : 1;
}

/* Warn, once, of what a run that goes on has noticed, and of inputs nobody has checked. */
static void warn(Instance *I, double time)
{
    char message[MESSAGE];
    int i;
    for (i = 0; i < NOTICES + CHECKED; i++) {
        const int input = i - NOTICES;
        const int due = i < NOTICES ? I->now.x[notices[i].place] != 0.0
            : I->now.values[input] < checked[input].low || I->now.values[input] > checked[input].high;
        if (due && !I->now.warned[i]) {
            I->now.warned[i] = 1;
            snprintf(message, sizeof message, "%s, at t = %g s",
                     i < NOTICES ? notices[i].message : checked[input].message, time);
            say(I, 1, message);
        }
    }
}

/* Prepare the step for the present parameters.
 *
 * The state stays as it is; an effect that wakes up begins at rest. */
static int retune(Instance *I)
{
    const double *parameters = I->now.values + FIRST_PARAMETER;
    double rest[SIZE];
    int32_t off[EFFECTS + 1];
    int i;
    for (i = 0; i < EFFECTS; i++)
        off[i] = 1;
    for (i = 0; i < SWITCHES; i++)
        if (parameters[switches[i].parameter] != 0.0)
            off[switches[i].effect] = 0;
    memset(&I->setup, 0, sizeof I->setup);
    if (prepare(&I->setup, parameters))
        return fail(I, "the parameters do not go together (division by zero or the like): change"
                       " the latest one back");
    at_rest(&I->setup, rest);
    if (!I->now.has_x)
        memcpy(I->now.x, rest, sizeof rest);
    else
        for (i = 0; i < KEPT; i++)
            if (owners[i] >= 0 && I->now.off[owners[i]] && !off[owners[i]])
                I->now.x[i] = rest[i];
    for (i = 0; i < EFFECTS; i++)
        I->now.off[i] = off[i];
    I->now.has_x = 1;
    I->longest = MOST_SUB_STEPS * I->setup.v_internal_step;
    I->furthest = FURTHEST * I->setup.v_internal_step;
    I->stale = 0;
    return 1;
}

/* Prepare the step for the present parameters, at rest, and look at the outputs at the start. */
static int prepare_start(Instance *I)
{
    double x[SIZE];
    I->now.has_x = 0;
    if (!retune(I))
        return 0;
    memcpy(x, I->now.x, sizeof x);
    return advance(I, x, I->now.begins, 0.0);
}

/* ---- the life of an instance ------------------------------------------------------------ */

static void reset(Instance *I)
{
    int i;
    memset(&I->now, 0, sizeof I->now);
    for (i = 0; i < VARIABLES; i++)
        I->now.values[i] = variables[i].start;
    I->now.last = HUGE_VAL;
    I->now.time = NAN;
    I->now.phase = INSTANTIATED;
    I->stale = 1;
    I->longest = 0.0;
}

static Instance *new_instance(Tell *tell, void *host)
{
    Instance *I = calloc(1, sizeof *I);
    if (I) {
        I->tell = tell;
        I->host = host;
        reset(I);
    }
    return I;
}

static int setup_experiment(Instance *I, const char *call, double start, int stops, double stop)
{
    if (!only(I, call, INSTANTIATED))
        return 0;
    if (!is_finite(start))
        return fail(I, "the start time %g is not finite: give a time in seconds", start);
    if (stops && !(stop >= start))
        return fail(I, "the stop time %g s is not after the start %g s", stop, start);
    I->now.begins = start;
    I->now.last = stops ? stop + SLACK * (1.0 + fabs(stop)) : HUGE_VAL;
    I->stale = 1;
    return 1;
}

static int enter_initialisation(Instance *I, const char *call)
{
    if (!only(I, call, INSTANTIATED))
        return 0;
    I->now.phase = INITIALISING;
    return 1;
}

static int exit_initialisation(Instance *I, const char *call)
{
    if (!only(I, call, INITIALISING))
        return 0;
    if (I->stale && !prepare_start(I))
        return 0;
    I->now.phase = RUNNING;
    I->now.time = I->now.begins;
    return 1;
}

static int refuse_step(Instance *I, const char *call, double time, double size)
{
    if (!only(I, call, RUNNING))
        return 0;
    if (!(size > 0.0 && is_finite(size)))
        return fail(I, "communication step of %g s: it must be positive and finite", size);
    if (size > I->longest)
        return fail(I, "communication step of %g s: it may hold %d internal steps, that is %g s;"
                       " make several of it", size, MOST_SUB_STEPS, I->longest);
    if (time + size > I->now.last)
        return fail(I, "the step to t = %g s goes beyond the stop time", time + size);
    if (fabs(time) + size > I->furthest)
        return fail(I, "the step to t = %g s ends more than %g s from 0, where numbers are too"
                       " coarse for the internal step: let time begin nearer to 0", time + size,
                    I->furthest);
    return fail(I, "the step begins at t = %.17g s, but the last one ended at t = %.17g s: steps"
                   " must follow each other", time, I->now.time);
}

static int do_step(Instance *I, const char *call, double time, double size)
{
    const double end = time + size;
    const double apart = fabs(time - I->now.time);
    if (I->stale && I->now.phase == RUNNING && !I->now.trouble[0] && !retune(I))
        return 0; /* first, since it says how long a step may be */
    if (!(apart <= SLACK * (1.0 + fabs(time)) && apart <= 0.5 * size && size > 0.0
          && size <= I->longest && end <= I->now.last && fabs(time) + size <= I->furthest
          && I->now.phase == RUNNING))
        return refuse_step(I, call, time, size);
    if (!advance(I, I->now.x, time, size))
        return 0;
    I->now.time = end;
    warn(I, end);
    return 1;
}

static int terminate(Instance *I, const char *call)
{
    if (I->now.trouble[0]) /* a host may end a run that has failed */
        return 1;
    if (!only(I, call, RUNNING))
        return 0;
    I->now.phase = TERMINATED;
    return 1;
}

/* ---- variables -------------------------------------------------------------------------- */

static int known(Instance *I, uint32_t reference, int flag)
{
    if (reference >= VARIABLES)
        return fail(I, "value reference %lu: this FMU has 0 to %d only", (unsigned long)reference,
                    LAST_REFERENCE);
    if (variables[reference].flag != flag)
        return fail(I, "value reference %lu: '%s' is a %s", (unsigned long)reference,
                    variables[reference].name, flag ? NUMBER : "Boolean");
    return 1;
}

/* Refuse a call with variables of a type that this FMU does not have. */
static int no_such_type(Instance *I, const char *type, size_t count)
{
    if (!sound(I, "reading or setting values"))
        return 0;
    return count ? fail(I, "this FMU has no %s that could be read or set so", type) : 1;
}

static int can_read(Instance *I, const uint32_t *references, size_t count, int flag)
{
    size_t i;
    if (!sound(I, "reading values"))
        return 0;
    for (i = 0; i < count; i++)
        if (!known(I, references[i], flag))
            return 0;
    return begun(I) || !I->stale || prepare_start(I);
}

static int refuse_value(Instance *I, uint32_t reference, double value)
{
    const Variable *v = &variables[reference];
    if (reference >= INPUTS && reference < FIRST_PARAMETER)
        return fail(I, "'%s' is an output: it cannot be set", v->name);
    if (!is_finite(value))
        return fail(I, "'%s' = %g is not finite: give a number in %s", v->name, value, v->unit);
    if (!(v->low <= value && value <= v->high))
        return fail(I, "'%s' = %g is outside [%g, %g] %s: choose a value inside", v->name, value,
                    v->low, v->high, v->unit);
    return fail(I, "'%s' is a fixed parameter: set it before initialisation ends, or reset",
                v->name);
}

static int can_set(Instance *I, uint32_t reference, double value)
{
    const Variable *v;
    if (reference >= VARIABLES)
        return known(I, reference, 0);
    v = &variables[reference];
    if ((reference >= INPUTS && reference < FIRST_PARAMETER) || (v->fixed && begun(I))
        || !(v->low <= value && value <= v->high))
        return refuse_value(I, reference, value);
    return 1;
}

/* Set all of them, or none where one is refused. */
static int set_values(Instance *I, const uint32_t *references, size_t count, const double *values)
{
    size_t i;
    if (!sound(I, "setting values"))
        return 0;
    if (I->now.phase == TERMINATED)
        return fail(I, "setting values after termination: reset first");
    for (i = 0; i < count; i++)
        if (!can_set(I, references[i], values[i]))
            return 0;
    for (i = 0; i < count; i++) {
        I->now.values[references[i]] = values[i];
        if (references[i] >= FIRST_PARAMETER)
            I->stale = 1;
    }
    if (!begun(I))
        I->stale = 1;
    return 1;
}

/* ---- derivatives ------------------------------------------------------------------------ */

/* Outputs with one variable moved, in "probe", which tells nobody. */
static int outputs_at(const Instance *I, Instance *probe, uint32_t reference, double by)
{
    double x[SIZE];
    const double value = I->now.values[reference] + by;
    memcpy(probe, I, sizeof *probe);
    probe->tell = NULL;
    if (!can_set(probe, reference, value))
        return 0;
    probe->now.values[reference] = value;
    if (!begun(probe))
        return prepare_start(probe);
    if ((reference >= FIRST_PARAMETER || probe->stale) && !retune(probe))
        return 0;
    memcpy(x, probe->now.x, sizeof x);
    return advance(probe, x, probe->now.time, 0.0);
}

/* Derivatives of all outputs with respect to an input or a parameter, at the present state.
 *
 * Returns 1, or 0 where one of the wanted outputs has no derivative: at a kink, a jump, a bound. */
static int slopes(const Instance *I, Instance probe[3], const uint32_t *unknowns, size_t count,
                  uint32_t reference, double *slope)
{
    const double size = fabs(I->now.values[reference]);
    const double by = DIFFERENCE * (size > variables[reference].nominal
                                        ? size : variables[reference].nominal);
    int good = outputs_at(I, probe, reference, 0.0)
        && outputs_at(I, probe + 1, reference, by) && outputs_at(I, probe + 2, reference, -by);
    size_t i;
    for (i = 0; good && i < count; i++) {
        const double here = probe[0].now.values[unknowns[i]];
        const double above = (probe[1].now.values[unknowns[i]] - here) / by;
        const double below = (here - probe[2].now.values[unknowns[i]]) / by;
        good = fabs(above - below)
            <= SMOOTH * (fabs(above) + fabs(below)) + ROUNDING * fabs(here) / by;
        slope[i] = 0.5 * (above + below);
    }
    return good;
}

/* What a call for derivatives came to. */
typedef enum { WRONG_CALL, NOT_SMOOTH, DERIVED } Derived;

/* Directional derivatives of outputs by a seed for each known, or adjoint ones of the knowns by a
 * seed for each unknown: Jacobian times seed, or seed times Jacobian. */
static Derived derive(Instance *I, const char *call, const uint32_t *unknowns, size_t count,
                      const uint32_t *knowns, size_t directions, int adjoint, const double *seed,
                      double *result)
{
    size_t i, j;
    double *slope;
    Instance *probe; /* here, above, below */
    Derived outcome = DERIVED;
    if (!sound(I, call))
        return WRONG_CALL;
    if (I->now.phase != INITIALISING && I->now.phase != RUNNING) {
        fail(I, "%s %s: it belongs in initialisation or behind it", call, phases[I->now.phase]);
        return WRONG_CALL;
    }
    for (i = 0; i < count; i++) {
        if (!known(I, unknowns[i], 0))
            return WRONG_CALL;
        if (unknowns[i] < INPUTS || unknowns[i] >= FIRST_PARAMETER) {
            fail(I, "'%s' is no output: it has no derivative", variables[unknowns[i]].name);
            return WRONG_CALL;
        }
    }
    for (j = 0; j < directions; j++) {
        if (!known(I, knowns[j], 0))
            return WRONG_CALL;
        if (knowns[j] >= INPUTS && knowns[j] < FIRST_PARAMETER) {
            fail(I, "'%s' is an output: derive with respect to inputs and parameters",
                 variables[knowns[j]].name);
            return WRONG_CALL;
        }
    }
    for (i = 0; i < (adjoint ? directions : count); i++)
        result[i] = 0.0;
    slope = malloc((count + 1) * sizeof *slope);
    probe = malloc(3 * sizeof *probe);
    if (!slope || !probe) {
        refuse(I, "%s: no memory for it", call);
        outcome = NOT_SMOOTH;
    }
    for (j = 0; outcome == DERIVED && j < directions; j++) {
        if (variables[knowns[j]].fixed && begun(I)) {
            refuse(I, "'%s' is a fixed parameter: derive with respect to it in initialisation",
                   variables[knowns[j]].name);
            outcome = NOT_SMOOTH;
        } else if (!slopes(I, probe, unknowns, count, knowns[j], slope)) {
            refuse(I, "no derivative with respect to '%s' = %g: there is a jump, a kink or a bound",
                   variables[knowns[j]].name, I->now.values[knowns[j]]);
            outcome = NOT_SMOOTH;
        }
        for (i = 0; outcome == DERIVED && i < count; i++)
            result[adjoint ? j : i] += slope[i] * seed[adjoint ? i : j];
    }
    free(slope);
    free(probe);
    return outcome;
}

/* ---- saved states ----------------------------------------------------------------------- */

/* FNV-1a of 64 bits: any single change of a byte changes it. */
static uint64_t digest_of(const void *content, size_t bytes, uint64_t digest)
{
    const unsigned char *byte = content;
    size_t i;
    for (i = 0; i < bytes; i++)
        digest = (digest ^ byte[i]) * UINT64_C(1099511628211);
    return digest;
}

static uint64_t digest_of_saved(const Saved *saved)
{
    Header header = saved->header;
    uint64_t digest = UINT64_C(14695981039346656037);
    header.digest = 0;
    digest = digest_of(&header, sizeof header, digest);
    return digest_of(&saved->state, sizeof saved->state, digest);
}

/* Write the whole state into "saved". */
static void save(const Instance *I, Saved *saved)
{
    memset(saved, 0, sizeof *saved);
    memcpy(saved->header.magic, "servofmu", sizeof saved->header.magic);
    memcpy(saved->header.identity, IDENTITY, sizeof saved->header.identity);
    saved->header.bytes = sizeof *saved;
    saved->header.one = 1.0;
    memcpy(&saved->state, &I->now, sizeof saved->state);
    saved->header.digest = digest_of_saved(saved);
}

/* Whether a state has the parts and bounds that an instance gives it. */
static int is_whole(const State *state)
{
    int i;
    if (state->phase < INSTANTIATED || state->phase > TERMINATED || !is_finite(state->begins)
        || state->last != state->last || state->trouble[MESSAGE - 1]
        || (state->has_x != 1 && (state->has_x != 0 || state->phase > INITIALISING)))
        return 0;
    for (i = 0; i < SIZE; i++)
        if (state->x[i] != state->x[i] || (i < STATES && !is_finite(state->x[i])))
            return 0;
    for (i = 0; i < EFFECTS; i++)
        if (state->off[i] != 0 && state->off[i] != 1)
            return 0;
    for (i = 0; i < VARIABLES; i++) {
        const int output = i >= INPUTS && i < FIRST_PARAMETER;
        const double value = state->values[i];
        if (value != value
            || (!output && !(variables[i].low <= value && value <= variables[i].high)))
            return 0;
    }
    return 1;
}

/* Whether a saved state of that many bytes is one of this FMU and undamaged. */
static int can_restore(Instance *I, const Saved *saved, size_t bytes)
{
    const Header *header = &saved->header;
    if (bytes < sizeof *header || memcmp(header->magic, "servofmu", sizeof header->magic) != 0
        || memcmp(header->identity, IDENTITY, sizeof header->identity) != 0)
        return fail(I, "the state to restore is damaged or was saved by another FMU");
    if (bytes != sizeof *saved || header->bytes != sizeof *saved || header->one != 1.0
        || header->digest != digest_of_saved(saved) || !is_whole(&saved->state))
        return fail(I, "the state to restore is damaged");
    return 1;
}

static int restore(Instance *I, const char *call, const Saved *saved)
{
    if (!saved)
        return fail(I, "%s: there is no state to restore (NULL)", call);
    if (!can_restore(I, saved, sizeof *saved))
        return 0;
    memcpy(&I->now, &saved->state, sizeof I->now);
    I->stale = 1;
    return 1;
}

/* Save into "saved", which is made where it is NULL. */
static int keep(Instance *I, void **saved)
{
    if (!*saved)
        *saved = malloc(sizeof(Saved));
    if (!*saved)
        return refuse(I, "no memory for a state of %lu bytes", (unsigned long)sizeof(Saved));
    save(I, *saved);
    return 1;
}

static int serialise(Instance *I, const void *saved, void *bytes, size_t size)
{
    if (size < sizeof(Saved))
        return fail(I, "a state has %lu bytes, and there is room for %lu",
                    (unsigned long)sizeof(Saved), (unsigned long)size);
    memcpy(bytes, saved, sizeof(Saved));
    return 1;
}

/* Make "saved" of bytes; damaged ones are refused here already.  Where the handle is to go may hold
 * anything before, so nothing is freed. */
static int deserialise(Instance *I, const void *bytes, size_t size, void **saved)
{
    Saved *made = calloc(1, sizeof *made);
    if (!made)
        return refuse(I, "no memory for a state of %lu bytes", (unsigned long)sizeof *made);
    memcpy(made, bytes, size < sizeof *made ? size : sizeof *made);
    if (!can_restore(I, made, size)) {
        free(made);
        return 0;
    }
    *saved = made;
    return 1;
}
