/* Random sequences of legal and illegal FMI 2.0 calls on the library of an FMU.
 *
 *     fmi_calls LIBRARY VARIABLES FIRST COUNT [THREADS]
 *
 * Plays the sequences of the seeds FIRST to FIRST + COUNT - 1.  Every sequence has a model of what
 * its instances are to answer (struct expected): a call that the standard and the FMU's bounds
 * allow succeeds, any other is refused with a message, and then nothing but a reset or a restored
 * state helps.  A fault is told with its seed, and the exit code is 1; with FMI_CALLS_TRACE in the
 * environment every call is printed before it is made.
 *
 * With THREADS each sequence runs alone first and then in that many threads at the same time,
 * where every status, number and message is to be the same.
 *
 * VARIABLES is what tests/fuzz/native.py writes: the GUID; 1 if there are directional derivatives;
 * then by line kind, value reference, bounds, start, nominal and name of a variable.
 *
 * fmi_expected.h has the model and the judgement of a call, fmi_legal.h the legal calls and the
 * replays, this file the actions of a sequence, most of which are wrong in some way.
 */
#define _POSIX_C_SOURCE 200809L
#include "fmi_expected.h"
#include "fmi_legal.h"

enum {
    CALLS = 40,    /* actions of a sequence, at most */
    PATIENCE = 60, /* seconds for a sequence, which takes milliseconds */
    MOST_SUB_STEPS = 1000000
};

/* ---- actions of a sequence, legal and illegal ------------------------------------------------ */

static void do_instantiate(struct sequence *s, struct instance *i)
{
    struct instance *place = free_place(s);
    if (place)
        i = instantiate(s, place);
    if (place && chance(s, 0.8))
        initialise(s, i);
}

static void do_free(struct sequence *s, struct instance *i)
{
    if (alive(s) > 1)
        free_instance(s, i);
    calling(s, "fmi2FreeInstance(NULL)");
    fmu.call.FreeInstance(NULL);
}

static void do_setup(struct sequence *s, struct instance *i)
{
    static const double starts[] = {0.0, 1.5, -2.0, 1e15, NAN, HUGE_VAL, -HUGE_VAL};
    const double start = starts[below(s, 7)];
    const double stops[] = {HUGE_VAL, start + 100.0 * internal_step(i), start, start - 1.0, NAN,
                            -HUGE_VAL};
    const double stop = stops[below(s, 6)];
    setup(s, i, start, stop,
          i->expected.phase != INSTANTIATED || !isfinite(start) || !(stop >= start) ? FAILS
                                                                                    : SUCCEEDS);
}

static void do_enter(struct sequence *s, struct instance *i)
{
    enter(s, i);
}

static void do_leave(struct sequence *s, struct instance *i)
{
    leave(s, i);
}

static void do_steps(struct sequence *s, struct instance *i)
{
    for (int count = below(s, 4); count >= 0; count--)
        legal_step(s, i);
}

static void do_wrong_step(struct sequence *s, struct instance *i)
{
    const double longest = MOST_SUB_STEPS * internal_step(i);
    const double sizes[] = {0.0, -0.0, -1e-3, NAN, HUGE_VAL, -HUGE_VAL, 1e9, 1e300, -1e300,
                            1.7976931348623157e308, 1.01 * longest};
    const double offsets[] = {1.0, -1e-3, NAN, HUGE_VAL, -HUGE_VAL, 1e300};
    const double time = i->expected.time == i->expected.time ? i->expected.time : 0.0;
    if (chance(s, 0.6))
        step(s, i, time, sizes[below(s, 11)], FAILS);
    else if (!i->expected.wild)
        step(s, i, time + offsets[below(s, 6)], internal_step(i), FAILS);
}

/* Steps so small that time hardly passes, or not at all. */
static void do_tiny_step(struct sequence *s, struct instance *i)
{
    static const double sizes[] = {4.9e-324, 2.2e-308, 1e-300, 1e-17, 1e-12};
    const double time = i->expected.time == i->expected.time ? i->expected.time : 0.0;
    step(s, i, time, sizes[below(s, 5)], legal_in(i, RUNNING) == FAILS ? FAILS : MAY_FAIL);
}

static void do_set(struct sequence *s, struct instance *i)
{
    struct values list;
    choose_usual(s, i, &list);
    set(s, i, &list, i->expected.phase == TERMINATED ? FAILS : SUCCEEDS);
}

static void do_set_wild(struct sequence *s, struct instance *i)
{
    struct values list = {.count = 0};
    for (int count = below(s, 5); count >= 0; count--) {
        const int k = below(s, fmu.count);
        if (can_be_set(k) && (fmu.variables[k].kind != FIXED || i->expected.phase < RUNNING))
            add(&list, k, wild_value(s, &fmu.variables[k]));
    }
    if (set(s, i, &list, i->expected.phase == TERMINATED ? FAILS : SUCCEEDS))
        i->expected.wild = 1;
}

/* One reference or one value among good ones is wrong. */
static void do_set_wrong(struct sequence *s, struct instance *i)
{
    static const double never[] = {NAN, -NAN, HUGE_VAL, -HUGE_VAL};
    const fmi2ValueReference unknown[] = {fmu.unknown, fmu.unknown + 1, 0x7fffffff, 0x80000000u,
                                          0x80000001u, 0xffffffffu};
    struct values list;
    int k = below(s, fmu.count);
    choose_usual(s, i, &list);
    if (list.count == (size_t)fmu.count)
        list.count--;
    add(&list, k, fmu.variables[k].start);
    const size_t at = list.count - 1;
    const struct variable *v = &fmu.variables[k];
    const int is_refused_anyway = !can_be_set(k) || (v->kind == FIXED
                                                     && i->expected.phase == RUNNING);
    if (chance(s, 0.3))
        list.references[at] = unknown[below(s, 6)];
    else if (chance(s, 0.5) && isfinite(v->high) && fabs(v->high) < 1e300)
        list.values[at] = nextafter(v->high, HUGE_VAL);
    else if (chance(s, 0.5) && isfinite(v->low) && fabs(v->low) < 1e300)
        list.values[at] = nextafter(v->low, -HUGE_VAL);
    else if (!is_refused_anyway || chance(s, 0.5))
        list.values[at] = never[below(s, 4)];
    if (chance(s, 0.5)) { /* the wrong one comes first */
        const fmi2ValueReference reference = list.references[at];
        const double value = list.values[at];
        list.references[at] = list.references[0];
        list.values[at] = list.values[0];
        list.references[0] = reference;
        list.values[0] = value;
    }
    set(s, i, &list, FAILS);
}

/* Random variables, some of them twice: inputs and parameters have the values that were set. */
static void do_get(struct sequence *s, struct instance *i)
{
    fmi2ValueReference references[16];
    int indices[16];
    double values[16];
    size_t count = 0;
    for (int tries = 16; tries > 0; tries--) {
        const int k = below(s, fmu.count);
        if (fmu.variables[k].kind != FLAG) {
            references[count] = fmu.variables[k].reference;
            indices[count++] = k;
        }
    }
    calling(s, "%s: fmi2GetReal of %zu", i->name, count);
    if (!succeeded(s, i, fmu.call.GetReal(i->component, references, count, values),
                   i->expected.phase < RUNNING ? legal_if_tame(i, SUCCEEDS) : SUCCEEDS))
        return;
    for (size_t k = 0; k < count; k++) {
        digest(s, &values[k], sizeof values[k]);
        if (!isfinite(values[k]))
            fault(s, "variable %u is %g", references[k], values[k]);
        if (can_be_set(indices[k]) && values[k] != i->expected.values[indices[k]])
            fault(s, "variable %u is %.17g instead of %.17g", references[k], values[k],
                  i->expected.values[indices[k]]);
    }
}

static void do_get_flags(struct sequence *s, struct instance *i)
{
    for (int k = 0; k < fmu.count; k++)
        if (fmu.variables[k].kind == FLAG) {
            fmi2Boolean flag = -1;
            calling(s, "%s: fmi2GetBoolean of %u", i->name, fmu.variables[k].reference);
            if (succeeded(s, i, fmu.call.GetBoolean(i->component, &fmu.variables[k].reference, 1,
                                                    &flag),
                          i->expected.phase < RUNNING ? legal_if_tame(i, SUCCEEDS) : SUCCEEDS)
                && flag != fmi2True && flag != fmi2False)
                fault(s, "a flag of %d", flag);
        }
}

static void do_get_wrong(struct sequence *s, struct instance *i)
{
    const fmi2ValueReference unknown[] = {fmu.unknown, 0x7fffffff, 0x80000000u, 0xffffffffu};
    fmi2ValueReference references[2] = {fmu.variables[0].reference, unknown[below(s, 4)]};
    double values[2];
    fmi2Boolean flags[2];
    const int k = below(s, fmu.count);
    if (fmu.variables[k].kind == FLAG && chance(s, 0.8))
        references[1] = fmu.variables[k].reference;
    calling(s, "%s: fmi2GetReal of %u and %u", i->name, references[0], references[1]);
    succeeded(s, i, fmu.call.GetReal(i->component, references, 2, values), FAILS);
    if (fmu.variables[k].kind != FLAG) {
        calling(s, "%s: fmi2GetBoolean of %u", i->name, fmu.variables[k].reference);
        succeeded(s, i, fmu.call.GetBoolean(i->component, &fmu.variables[k].reference, 1, flags),
                  FAILS);
    }
}

static void do_wrong_type(struct sequence *s, struct instance *i)
{
    const fmi2ValueReference *reference = &fmu.variables[below(s, fmu.count)].reference;
    fmi2Integer integer = 1;
    fmi2String text = "1";
    fmi2Status status = fmi2OK;
    const int which = below(s, 5);
    calling(s, "%s: wrong type %d for %u", i->name, which, *reference);
    switch (which) {
    case 0:
        status = fmu.call.GetInteger(i->component, reference, 1, &integer);
        break;
    case 1:
        status = fmu.call.GetString(i->component, reference, 1, &text);
        break;
    case 2:
        status = fmu.call.SetInteger(i->component, reference, 1, &integer);
        break;
    case 3:
        status = fmu.call.SetBoolean(i->component, reference, 1, &integer);
        break;
    default:
        status = fmu.call.SetString(i->component, reference, 1, &text);
    }
    succeeded(s, i, status, FAILS);
}

static void do_terminate(struct sequence *s, struct instance *i)
{
    calling(s, "%s: fmi2Terminate", i->name);
    if (allowed_after_failure(s, i, fmu.call.Terminate(i->component), legal_in(i, RUNNING))
        && !i->expected.failed) {
        i->expected.phase = TERMINATED;
        i->expected.time = NAN;
    }
}

static void do_reset(struct sequence *s, struct instance *i)
{
    reset(s, i);
    if (chance(s, 0.7))
        initialise(s, i);
}

static void do_save(struct sequence *s, struct instance *i)
{
    struct saved *saved = &s->saved[below(s, STATES)];
    calling(s, "%s: fmi2GetFMUstate into %p", i->name, saved->state);
    if (is_refused(s, fmu.call.GetFMUstate(i->component, &saved->state))) {
        if (!i->expected.failed)
            fault(s, "refused");
        return; /* what was there is still there */
    }
    if (!saved->state)
        fault(s, "gives no state");
    saved->expected = i->expected;
    if (!i->expected.failed && i->expected.phase >= RUNNING)
        get_outputs(s, i, saved->outputs);
    if (chance(s, 0.3))
        saved->state = by_bytes(s, i, saved->state);
}

static void do_restore(struct sequence *s, struct instance *i)
{
    const struct saved *saved = &s->saved[below(s, STATES)];
    if (saved->state)
        restore(s, i, saved);
}

static void do_free_state(struct sequence *s, struct instance *i)
{
    struct saved *saved = &s->saved[below(s, STATES)];
    free_state(s, i, saved); /* one that is NULL is legal too */
}

/* Bytes that differ from the good ones. */
static struct bytes damaged(struct sequence *s, struct bytes good)
{
    struct bytes bad = {NULL, good.size};
    const int kind = below(s, 5);
    if (kind == 1)
        bad.size = (size_t)below(s, (int)good.size);
    if (kind == 2)
        bad.size += 1 + (size_t)below(s, 100);
    bad.bytes = calloc(1, bad.size ? bad.size : 1);
    memcpy(bad.bytes, good.bytes, bad.size < good.size ? bad.size : good.size);
    if (kind == 3) /* a stretch of zeros, where there was something */
        for (int n = below(s, 64), at = below(s, (int)good.size); n >= 0; n--)
            if ((size_t)(at + n) < good.size)
                bad.bytes[at + n] = 0;
    if (kind == 4) /* anything */
        for (size_t at = 0; at < bad.size; at++)
            bad.bytes[at] = (char)random_bits(s);
    if (bad.size == good.size) /* at least one bit is wrong */
        for (int n = below(s, 3); n >= 0; n--)
            do
                bad.bytes[below(s, (int)bad.size)] ^= (char)(1 << below(s, 8));
            while (memcmp(bad.bytes, good.bytes, good.size) == 0);
    return bad;
}

static void do_restore_damaged(struct sequence *s, struct instance *i)
{
    if (i->expected.failed)
        return;
    fmi2FMUstate state = get_state(s, i);
    struct bytes good = serialise(s, i, state), bad = damaged(s, good);
    if (is_refused(s, fmu.call.FreeFMUstate(i->component, &state)))
        fault(s, "a state cannot be freed");
    calling(s, "%s: fmi2DeSerializeFMUstate of damaged %zu bytes", i->name, bad.size);
    if (succeeded(s, i, fmu.call.DeSerializeFMUstate(i->component, bad.bytes, bad.size, &state),
                  MAY_FAIL)) {
        calling(s, "%s: fmi2SetFMUstate of a damaged state", i->name);
        succeeded(s, i, fmu.call.SetFMUstate(i->component, state), FAILS);
        if (is_refused(s, fmu.call.FreeFMUstate(i->component, &state)))
            fault(s, "a state cannot be freed");
    } else if (state) {
        fault(s, "refused, but gives a state");
    }
    free(good.bytes);
    free(bad.bytes);
}

static void do_derivatives(struct sequence *s, struct instance *i)
{
    fmi2ValueReference unknowns[4], knowns[4];
    double seed[4], found[4];
    const int n = below(s, 4), m = below(s, 4);
    for (int k = 0; k < 4; k++) {
        unknowns[k] = fmu.variables[chance(s, 0.9) ? fmu.outputs[below(s, fmu.output_count)]
                                                   : below(s, fmu.count)].reference;
        knowns[k] = chance(s, 0.05) ? 0x80000000u : fmu.variables[below(s, fmu.count)].reference;
        seed[k] = between(s, -2.0, 2.0);
    }
    calling(s, "%s: fmi2GetDirectionalDerivative, %d by %d", i->name, n, m);
    if (succeeded(s, i, fmu.call.GetDirectionalDerivative(i->component, unknowns, (size_t)n, knowns,
                                                          (size_t)m, seed, found), MAY_FAIL))
        for (int k = 0; k < n; k++)
            if (!isfinite(found[k]))
                fault(s, "a derivative of %g", found[k]);
}

static void do_input_output_derivatives(struct sequence *s, struct instance *i)
{
    const fmi2ValueReference reference = fmu.variables[below(s, fmu.count)].reference;
    const fmi2Integer order = below(s, 4) - 1;
    double value = 1.0;
    calling(s, "%s: fmi2GetRealOutputDerivatives of order %d", i->name, order);
    succeeded(s, i, fmu.call.GetRealOutputDerivatives(i->component, &reference, 1, &order, &value),
              MAY_FAIL);
    calling(s, "%s: fmi2SetRealInputDerivatives of order %d", i->name, order);
    if (succeeded(s, i, fmu.call.SetRealInputDerivatives(i->component, &reference, 1, &order,
                                                         &value), MAY_FAIL))
        fault(s, "an input derivative is taken, which the description excludes");
}

/* Questions about the status: refused or not, they leave the instance as it is. */
static void do_status(struct sequence *s, struct instance *i)
{
    const fmi2StatusKind kind = (fmi2StatusKind)below(s, 4);
    const int failed = i->expected.failed;
    fmi2Status status;
    fmi2Real real = 0.0;
    fmi2Integer integer;
    fmi2Boolean boolean = 0;
    fmi2String text;
    calling(s, "%s: status %d", i->name, kind);
    switch (below(s, 6)) {
    case 0:
        is_refused(s, fmu.call.GetStatus(i->component, kind, &status));
        break;
    case 1:
        if (!is_refused(s, fmu.call.GetRealStatus(i->component, kind, &real)) && !failed
            && (kind != fmi2LastSuccessfulTime || real != i->expected.time))
            fault(s, "the last time is %.17g, not %.17g", real, i->expected.time);
        break;
    case 2:
        is_refused(s, fmu.call.GetIntegerStatus(i->component, kind, &integer));
        break;
    case 3:
        if (!is_refused(s, fmu.call.GetBooleanStatus(i->component, kind, &boolean)) && boolean)
            fault(s, "terminated");
        break;
    case 4:
        is_refused(s, fmu.call.GetStringStatus(i->component, kind, &text));
        break;
    default:
        is_refused(s, fmu.call.CancelStep(i->component));
    }
    probe(s, i);
    if (!failed && i->expected.failed && !(i->expected.wild && i->expected.phase < RUNNING))
        fault(s, "the instance has failed by a question");
}

static void do_debug_logging(struct sequence *s, struct instance *i)
{
    const fmi2String categories[] = {"logAll", "logStatusError", "unknown", "", "%s%n", NULL};
    const fmi2String chosen[] = {categories[below(s, 6)], categories[below(s, 6)]};
    calling(s, "%s: fmi2SetDebugLogging", i->name);
    allowed_after_failure(s, i, fmu.call.SetDebugLogging(i->component, below(s, 2),
                                                         (size_t)below(s, 3), chosen), MAY_FAIL);
}

static void do_inquire(struct sequence *s, struct instance *i)
{
    calling(s, "%s: inquiries", i->name);
    if (strcmp(fmu.call.GetVersion(), "2.0") != 0
        || strcmp(fmu.call.GetTypesPlatform(), "default") != 0)
        fault(s, "wrong answers");
}

/* ---- pointers that are not there --------------------------------------------------------------- */

static void do_instantiate_wrong(struct sequence *s, struct instance *i)
{
    fmi2CallbackFunctions callbacks;
    const fmi2CallbackFunctions *functions = callbacks_of(s, &callbacks);
    fmi2String name = "?", guid = fmu.guid;
    fmi2Type type = fmi2CoSimulation;
    const int which = below(s, 8), must_refuse = which < 4;
    (void)i;
    if (which == 0)
        name = NULL;
    else if (which == 1)
        guid = NULL;
    else if (which == 2)
        guid = chance(s, 0.5) ? "" : "{00000000-0000-0000-0000-000000000000}";
    else if (which == 3)
        type = chance(s, 0.5) ? fmi2ModelExchange : (fmi2Type)2;
    else if (which == 4)
        functions = NULL;
    else if (which == 5)
        callbacks.logger = NULL;
    else if (which == 6)
        name = "";
    else
        callbacks.allocateMemory = NULL;
    calling(s, "fmi2Instantiate, wrong in %d", which);
    fmi2Component component = fmu.call.Instantiate(name, type, guid, "", functions, 0, below(s, 2));
    if (component && must_refuse)
        fault(s, "gives an instance");
    if (!component)
        need_message(s);
    fmu.call.FreeInstance(component);
}

static void do_null_component(struct sequence *s, struct instance *i)
{
    fmi2ValueReference r = 0;
    double x = 0.0;
    int n = 0;
    size_t size;
    fmi2String text = "";
    fmi2FMUstate state = NULL;
    fmi2Status status;
    (void)i;
#define NO_COMPONENT(name, ...)                                          \
    calling(s, "fmi2" #name " without an instance");                     \
    if (!is_refused(s, fmu.call.name(__VA_ARGS__)))                      \
        fault(s, "accepted");
    switch (below(s, 7)) {
    case 0:
        NO_COMPONENT(SetupExperiment, NULL, 0, 0.0, 0.0, 0, 0.0)
        NO_COMPONENT(EnterInitializationMode, NULL)
        NO_COMPONENT(ExitInitializationMode, NULL)
        NO_COMPONENT(Terminate, NULL)
        NO_COMPONENT(Reset, NULL)
        break;
    case 1:
        NO_COMPONENT(GetReal, NULL, &r, 1, &x)
        NO_COMPONENT(GetInteger, NULL, &r, 1, &n)
        NO_COMPONENT(GetBoolean, NULL, &r, 1, &n)
        NO_COMPONENT(GetString, NULL, &r, 1, &text)
        break;
    case 2:
        NO_COMPONENT(SetReal, NULL, &r, 1, &x)
        NO_COMPONENT(SetInteger, NULL, &r, 1, &n)
        NO_COMPONENT(SetBoolean, NULL, &r, 1, &n)
        NO_COMPONENT(SetString, NULL, &r, 1, &text)
        break;
    case 3:
        NO_COMPONENT(GetFMUstate, NULL, &state)
        NO_COMPONENT(SetFMUstate, NULL, NULL)
        NO_COMPONENT(SerializedFMUstateSize, NULL, NULL, &size)
        NO_COMPONENT(SerializeFMUstate, NULL, NULL, NULL, 0)
        NO_COMPONENT(DeSerializeFMUstate, NULL, "", 0, &state)
        break;
    case 4:
        NO_COMPONENT(GetDirectionalDerivative, NULL, &r, 1, &r, 1, &x, &x)
        NO_COMPONENT(SetRealInputDerivatives, NULL, &r, 1, &n, &x)
        NO_COMPONENT(GetRealOutputDerivatives, NULL, &r, 1, &n, &x)
        NO_COMPONENT(SetDebugLogging, NULL, 1, 0, NULL)
        break;
    case 5:
        NO_COMPONENT(GetStatus, NULL, fmi2DoStepStatus, &status)
        NO_COMPONENT(GetRealStatus, NULL, fmi2LastSuccessfulTime, &x)
        NO_COMPONENT(GetIntegerStatus, NULL, fmi2DoStepStatus, &n)
        NO_COMPONENT(GetBooleanStatus, NULL, fmi2Terminated, &n)
        NO_COMPONENT(GetStringStatus, NULL, fmi2PendingStatus, &text)
        break;
    default:
        NO_COMPONENT(DoStep, NULL, 0.0, 1e-3, 1)
        NO_COMPONENT(CancelStep, NULL)
    }
}

static void do_null_pointer(struct sequence *s, struct instance *i)
{
    const fmi2ValueReference r[2] = {fmu.variables[0].reference, fmu.variables[0].reference};
    fmi2Component c = i->component;
    double x[2] = {0.0, 0.0};
    int n[2] = {1, 1};
    char room[4];
    size_t size;
    fmi2FMUstate state = NULL;
#define MISSING(function, ...)                                \
    calling(s, "%s: NULL for fmi2" #function, i->name);       \
    succeeded(s, i, fmu.call.function(__VA_ARGS__), REFUSED); \
    break;
    switch (below(s, 24)) {
    case 0: MISSING(GetReal, c, NULL, 2, x)
    case 1: MISSING(GetReal, c, r, 2, NULL)
    case 2: MISSING(GetBoolean, c, NULL, 2, n)
    case 3: MISSING(GetInteger, c, NULL, 2, n)
    case 4: MISSING(GetString, c, NULL, 2, NULL)
    case 5: MISSING(SetReal, c, NULL, 2, x)
    case 6: MISSING(SetReal, c, r, 2, NULL)
    case 7: MISSING(SetInteger, c, NULL, 2, NULL)
    case 8: MISSING(SetBoolean, c, NULL, 2, NULL)
    case 9: MISSING(SetString, c, r, 2, NULL)
    case 10: MISSING(GetFMUstate, c, NULL)
    case 11: MISSING(SetFMUstate, c, NULL)
    case 12: MISSING(SerializedFMUstateSize, c, NULL, &size)
    case 13: MISSING(SerializeFMUstate, c, NULL, room, sizeof room)
    case 14: MISSING(DeSerializeFMUstate, c, NULL, 100, &state)
    case 15: MISSING(DeSerializeFMUstate, c, room, 0, NULL)
    case 16: MISSING(GetDirectionalDerivative, c, NULL, 2, r, 2, x, x)
    case 17: MISSING(GetDirectionalDerivative, c, r, 2, NULL, 2, x, x)
    case 18: MISSING(GetDirectionalDerivative, c, r, 2, r, 2, NULL, x)
    case 19: MISSING(GetDirectionalDerivative, c, r, 2, r, 2, x, NULL)
    case 20: MISSING(SetRealInputDerivatives, c, NULL, 2, NULL, NULL)
    case 21: MISSING(GetRealOutputDerivatives, c, NULL, 2, NULL, NULL)
    case 22: MISSING(SetRealInputDerivatives, c, r, 2, n, NULL)
    default: MISSING(GetRealOutputDerivatives, c, r, 2, n, NULL)
    }
    calling(s, "%s: no values, and no arrays for them", i->name);
    succeeded(s, i, fmu.call.GetReal(c, NULL, 0, NULL),
              i->expected.phase < RUNNING ? legal_if_tame(i, SUCCEEDS) : SUCCEEDS);
}

/* Too little room for the bytes of a state. */
static void do_small_room(struct sequence *s, struct instance *i)
{
    if (i->expected.failed)
        return;
    fmi2FMUstate state = get_state(s, i);
    size_t size;
    if (is_refused(s, fmu.call.SerializedFMUstateSize(i->component, state, &size)))
        fault(s, "the size is refused");
    size = (size_t)below(s, (int)size);
    char *room = malloc(size ? size : 1);
    calling(s, "%s: fmi2SerializeFMUstate into %zu bytes", i->name, size);
    succeeded(s, i, fmu.call.SerializeFMUstate(i->component, state, room, size), REFUSED);
    free(room);
    if (is_refused(s, fmu.call.FreeFMUstate(i->component, &state)))
        fault(s, "a state cannot be freed");
}

/* Memory runs out in a call: it is refused, or did without. */
static void do_run_out_of_memory(struct sequence *s, struct instance *i)
{
    fmi2CallbackFunctions callbacks;
    fmi2Component component = NULL;
    fmi2FMUstate state = NULL;
    double one = 1.0, slope = 0.0, again = 0.0;
    const fmi2ValueReference *output = &fmu.variables[fmu.outputs[0]].reference;
    const fmi2ValueReference *input = &fmu.variables[0].reference;
    const int left = below(s, 3);
    if (i->expected.failed)
        return;
    callbacks_of(s, &callbacks);
    switch (below(s, 3)) {
    case 0:
        calling(s, "fmi2Instantiate with memory for %d blocks", left);
        allocations_left = left;
        component = fmu.call.Instantiate("?", fmi2CoSimulation, fmu.guid, "", &callbacks, 0, 1);
        allocations_left = -1;
        if (!component)
            need_message(s);
        fmu.call.FreeInstance(component);
        break;
    case 1:
        calling(s, "%s: fmi2GetFMUstate with memory for %d blocks", i->name, left);
        allocations_left = left;
        const fmi2Status status = fmu.call.GetFMUstate(i->component, &state);
        allocations_left = -1;
        if (succeeded(s, i, status, MAY_FAIL) != (state != NULL))
            fault(s, "its status and its state say different things");
        if (is_refused(s, fmu.call.FreeFMUstate(i->component, &state)))
            fault(s, "a state cannot be freed");
        break;
    default:
        if (!fmu.has_derivatives || i->expected.phase != RUNNING)
            return;
        calling(s, "%s: fmi2GetDirectionalDerivative with memory for %d blocks", i->name, left);
        allocations_left = left;
        const fmi2Status derived = fmu.call.GetDirectionalDerivative(i->component, output, 1, input,
                                                                     1, &one, &slope);
        allocations_left = -1;
        if (!succeeded(s, i, derived, MAY_FAIL))
            return;
        if (is_refused(s, fmu.call.GetDirectionalDerivative(i->component, output, 1, input, 1, &one,
                                                            &again))
            || slope != again)
            fault(s, "a derivative of %g, and %g with memory", slope, again);
    }
}

/* ---- sequences ------------------------------------------------------------------------------ */

static const struct {
    void (*act)(struct sequence *, struct instance *);
    int weight;
} actions[] = {
    {do_steps, 24}, {do_set, 8}, {do_get, 6}, {do_get_flags, 2}, {replay_from_state, 8},
    {replay_from_start, 3}, {do_save, 6}, {do_restore, 8}, {do_free_state, 2}, {do_reset, 6},
    {do_instantiate, 4}, {do_free, 2}, {do_enter, 2}, {do_leave, 3}, {do_setup, 2},
    {do_terminate, 1}, {do_tiny_step, 1}, {do_set_wild, 3}, {do_derivatives, 2},
    {do_input_output_derivatives, 1}, {do_status, 3}, {do_debug_logging, 2}, {do_inquire, 1},
    {do_wrong_step, 2}, {do_set_wrong, 2}, {do_get_wrong, 1}, {do_wrong_type, 1},
    {do_restore_damaged, 4}, {do_small_room, 1}, {do_null_pointer, 2}, {do_null_component, 1},
    {do_instantiate_wrong, 2}, {do_run_out_of_memory, 2},
};
enum { ACTIONS = sizeof actions / sizeof *actions };

static void act(struct sequence *s)
{
    int total = 0, chosen = 0;
    for (int k = 0; k < ACTIONS; k++)
        total += actions[k].weight;
    for (int left = below(s, total); (left -= actions[chosen].weight) >= 0; chosen++)
        ;
    struct instance *i = any_instance(s);
    if (i->expected.failed && chance(s, 0.3)) /* few of the others do anything now */
        do_reset(s, i);
    else
        actions[chosen].act(s, i);
}

/* Play the sequence of a seed: a digest of everything that the FMU has answered. */
static uint64_t play(uint64_t seed, struct counts *counts)
{
    struct sequence *s = calloc(1, sizeof *s);
    s->seed = seed;
    s->random = seed * UINT64_C(0xd1342543de82ef95) + 1;
    s->digest = UINT64_C(14695981039346656037);
    do_instantiate(s, NULL);
    for (int count = below(s, CALLS); count >= 0; count--)
        act(s);
    while (alive(s))
        free_instance(s, any_instance(s));
    const uint64_t found = s->digest;
    counts->calls += s->counts.calls;
    counts->refused += s->counts.refused;
    counts->steps += s->counts.steps;
    free(s);
    return found;
}

static void empty_stderr(void)
{
    if (ftruncate(STDERR_FILENO, 0) == 0)
        lseek(STDERR_FILENO, 0, SEEK_SET);
}

static void play_all(uint64_t first, uint64_t count, struct counts *counts)
{
    for (uint64_t seed = first; seed < first + count; seed++) {
        printf("seed %" PRIu64 "\n", seed); /* the last one is at fault in a crash or a hang */
        fflush(stdout);
        alarm(PATIENCE);
        play(seed, counts);
        empty_stderr();
    }
}

struct together {
    uint64_t first, count, offset;
    const uint64_t *digests;
};

/* In a thread: the sequences from an offset on, and then those before it. */
static void *play_together(void *given)
{
    const struct together *t = given;
    struct counts counts = {0, 0, 0};
    for (uint64_t k = 0; k < t->count; k++) {
        const uint64_t at = (k + t->offset) % t->count;
        if (play(t->first + at, &counts) != t->digests[at]) {
            printf("FAULT in sequence %" PRIu64 ": other answers than alone\n", t->first + at);
            fflush(stdout);
            _exit(1);
        }
    }
    return NULL;
}

static void play_in_threads(uint64_t first, uint64_t count, struct counts *counts)
{
    pthread_t threads[64];
    struct together given[64];
    uint64_t *digests = malloc(count * sizeof *digests);
    alarm(PATIENCE);
    for (uint64_t k = 0; k < count; k++)
        digests[k] = play(first + k, counts);
    for (int k = 0; k < fmu.threads; k++) {
        given[k] = (struct together){first, count, count * (uint64_t)k / (uint64_t)fmu.threads,
                                     digests};
        if (pthread_create(&threads[k], NULL, play_together, &given[k]))
            abort();
    }
    for (int k = 0; k < fmu.threads; k++)
        pthread_join(threads[k], NULL);
    free(digests);
}

int main(int count, char **words)
{
    if (count < 5) {
        fprintf(stderr, "usage: fmi_calls LIBRARY VARIABLES FIRST COUNT [THREADS]\n");
        return 2;
    }
    fmu.call = load_library(words[1]);
    read_variables(words[2]);
    const uint64_t first = strtoull(words[3], NULL, 10), sequences = strtoull(words[4], NULL, 10);
    fmu.threads = count > 5 ? atoi(words[5]) : 0;
    fmu.traces = getenv("FMI_CALLS_TRACE") != NULL;
    FILE *messages = tmpfile(); /* without a logger the FMU writes here; see need_message */
    if (!messages || fmu.threads > 64 || !fmu.output_count)
        return 2;
    dup2(fileno(messages), STDERR_FILENO);
    fclose(messages);
    struct counts counts = {0, 0, 0};
    if (fmu.threads)
        play_in_threads(first, sequences, &counts);
    else
        play_all(first, sequences, &counts);
    printf("played %" PRIu64 " calls %" PRIu64 " refused %" PRIu64 " steps %" PRIu64 "\n",
           sequences, counts.calls, counts.refused, counts.steps);
    return 0;
}
