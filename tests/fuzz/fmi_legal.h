/* Part of fmi_calls.c: legal calls, states saved and restored, and replays. */

enum { SCRIPT = 12 }; /* steps of a replay, at most */

/* ---- places, instances, states ------------------------------------------------------------ */

static struct instance *free_place(struct sequence *s)
{
    for (int i = 0; i < INSTANCES; i++)
        if (!s->instances[i].component)
            return &s->instances[i];
    return NULL;
}

static int alive(const struct sequence *s)
{
    int count = 0;
    for (int i = 0; i < INSTANCES; i++)
        count += s->instances[i].component != NULL;
    return count;
}

/* A random instance that is alive; there is one while a sequence runs. */
static struct instance *any_instance(struct sequence *s)
{
    for (;;) {
        struct instance *i = &s->instances[below(s, INSTANCES)];
        if (i->component)
            return i;
    }
}

static void expect_start(struct expected *e)
{
    memset(e, 0, sizeof *e);
    e->phase = INSTANTIATED;
    e->last = HUGE_VAL;
    e->time = NAN;
    for (int k = 0; k < fmu.count; k++)
        e->values[k] = fmu.variables[k].start;
}

static void no_step_finished(void *environment, fmi2Status status)
{
    (void)environment;
    (void)status;
    abort(); /* only for slaves that run asynchronously */
}

static const fmi2CallbackFunctions *callbacks_of(struct sequence *s, fmi2CallbackFunctions *found)
{
    *found = (fmi2CallbackFunctions){logger, calloc, free, NULL, s};
    if (chance(s, 0.1))
        found->stepFinished = no_step_finished;
    return found;
}

static struct instance *instantiate(struct sequence *s, struct instance *i)
{
    static const char *const names[] = {"a", "b%s%n", "servo 100%", "\xc3\xa4 \"quoted\" <&>"};
    fmi2CallbackFunctions callbacks;
    snprintf(i->name, sizeof i->name, "%s %d", names[below(s, 4)], s->instantiated++);
    calling(s, "%s: fmi2Instantiate", i->name);
    i->component = fmu.call.Instantiate(i->name, fmi2CoSimulation, fmu.guid,
                                        chance(s, 0.5) ? "file:///nowhere" : NULL,
                                        callbacks_of(s, &callbacks), below(s, 2), below(s, 2));
    if (!i->component)
        fault(s, "NULL");
    expect_start(&i->expected);
    return i;
}

static void free_state(struct sequence *s, struct instance *i, struct saved *saved)
{
    calling(s, "%s: fmi2FreeFMUstate of %p", i->name, saved->state);
    if (is_refused(s, fmu.call.FreeFMUstate(i->component, &saved->state)))
        fault(s, "refused");
    if (saved->state)
        fault(s, "the handle is not NULL afterwards");
}

static void free_instance(struct sequence *s, struct instance *i)
{
    if (alive(s) == 1) /* a state is freed through some instance of its FMU */
        for (int k = 0; k < STATES; k++)
            if (s->saved[k].state)
                free_state(s, i, &s->saved[k]);
    calling(s, "%s: fmi2FreeInstance", i->name);
    fmu.call.FreeInstance(i->component);
    i->component = NULL;
}

/* ---- legal calls --------------------------------------------------------------------------- */

static int setup(struct sequence *s, struct instance *i, double start, double stop,
                 enum outcome outcome)
{
    struct expected *e = &i->expected;
    const int stops = stop < HUGE_VAL || stop != stop;
    calling(s, "%s: fmi2SetupExperiment from %g to %g", i->name, start, stop);
    if (!succeeded(s, i, fmu.call.SetupExperiment(i->component, below(s, 2), between(s, -1.0, 1.0),
                                                  start, stops, stop), outcome))
        return 0;
    e->begins = start;
    e->last = stop;
    e->wild = e->wild || fabs(start) > 1e3; /* a step is lost in rounding there */
    return 1;
}

static enum outcome legal_in(const struct instance *i, enum phase phase)
{
    return i->expected.phase == phase ? SUCCEEDS : FAILS;
}

/* Once more where legal values far from the usual ones may be refused. */
static enum outcome legal_if_tame(const struct instance *i, enum outcome outcome)
{
    return outcome == SUCCEEDS && i->expected.wild ? MAY_FAIL : outcome;
}

static void enter(struct sequence *s, struct instance *i)
{
    calling(s, "%s: fmi2EnterInitializationMode", i->name);
    if (succeeded(s, i, fmu.call.EnterInitializationMode(i->component),
                  legal_in(i, INSTANTIATED)))
        i->expected.phase = INITIALISING;
}

static void leave(struct sequence *s, struct instance *i)
{
    calling(s, "%s: fmi2ExitInitializationMode", i->name);
    if (succeeded(s, i, fmu.call.ExitInitializationMode(i->component),
                  legal_if_tame(i, legal_in(i, INITIALISING)))) {
        i->expected.phase = RUNNING;
        i->expected.time = i->expected.begins;
    }
}

static void reset(struct sequence *s, struct instance *i)
{
    calling(s, "%s: fmi2Reset", i->name);
    if (is_refused(s, fmu.call.Reset(i->component)))
        fault(s, "refused");
    expect_start(&i->expected);
}

static double clipped(const struct variable *v, double value)
{
    return value < v->low ? v->low : value > v->high ? v->high : value;
}

/* A value near the one at the start, with which every run succeeds. */
static double usual_value(struct sequence *s, const struct variable *v)
{
    const double width = 0.1 * (v->kind == INPUT ? v->nominal : fabs(v->start));
    return clipped(v, v->start + width * between(s, -1.0, 1.0));
}

/* Any value within bounds. */
static double wild_value(struct sequence *s, const struct variable *v)
{
    switch (below(s, 6)) {
    case 0:
        return v->low;
    case 1:
        return v->high;
    case 2:
        return clipped(v, 0.0);
    case 3:
        return clipped(v, v->nominal * pow(10.0, between(s, -12.0, 12.0)));
    case 4:
        return clipped(v, v->nominal * between(s, -3.0, 3.0));
    default:
        return clipped(v, v->low + (v->high - v->low) * between(s, 0.0, 1.0));
    }
}

struct values {
    fmi2ValueReference references[VARIABLES];
    double values[VARIABLES];
    int indices[VARIABLES];
    size_t count;
};

static void add(struct values *list, int index, double value)
{
    list->references[list->count] = fmu.variables[index].reference;
    list->indices[list->count] = index;
    list->values[list->count++] = value;
}

/* Inputs, and parameters if they may still be set, each with some probability. */
static void choose_usual(struct sequence *s, const struct instance *i, struct values *list)
{
    const double share = between(s, 0.0, 1.0);
    list->count = 0;
    for (int k = 0; k < fmu.count; k++)
        if (can_be_set(k) && (i->expected.phase < RUNNING || fmu.variables[k].kind != FIXED)
            && chance(s, fmu.variables[k].kind == INPUT ? share : 0.3 * share))
            add(list, k, usual_value(s, &fmu.variables[k]));
}

static int set(struct sequence *s, struct instance *i, const struct values *list,
               enum outcome outcome)
{
    char texts[160] = "";
    for (size_t k = 0; fmu.traces && k < list->count && k < 4; k++)
        snprintf(texts + strlen(texts), sizeof texts - strlen(texts), " %u=%.17g",
                 list->references[k], list->values[k]);
    calling(s, "%s: fmi2SetReal of %zu:%s", i->name, list->count, texts);
    if (!succeeded(s, i, fmu.call.SetReal(i->component, list->references, list->count,
                                          list->values), outcome))
        return 0;
    for (size_t k = 0; k < list->count; k++)
        i->expected.values[list->indices[k]] = list->values[k];
    return 1;
}

/* Read all real outputs; they are finite. */
static int get_outputs(struct sequence *s, struct instance *i, double *values)
{
    fmi2ValueReference references[OUTPUTS];
    const enum outcome outcome = i->expected.phase < RUNNING ? legal_if_tame(i, SUCCEEDS)
                                                             : SUCCEEDS;
    for (int k = 0; k < fmu.output_count; k++)
        references[k] = fmu.variables[fmu.outputs[k]].reference;
    calling(s, "%s: fmi2GetReal of all outputs", i->name);
    if (!succeeded(s, i, fmu.call.GetReal(i->component, references, (size_t)fmu.output_count,
                                          values), outcome))
        return 0;
    digest(s, values, (size_t)fmu.output_count * sizeof *values);
    for (int k = 0; k < fmu.output_count; k++)
        if (!isfinite(values[k]))
            fault(s, "output %u is %g", references[k], values[k]);
    return 1;
}

static int step(struct sequence *s, struct instance *i, double time, double size,
                enum outcome outcome)
{
    double outputs[OUTPUTS];
    calling(s, "%s: fmi2DoStep at %.17g by %.17g", i->name, time, size);
    if (!succeeded(s, i, fmu.call.DoStep(i->component, time, size, below(s, 2)), outcome))
        return 0;
    s->counts.steps++;
    i->expected.time = time + size;
    return get_outputs(s, i, outputs);
}

static double internal_step(const struct instance *i)
{
    return fmu.internal_step < 0 ? 1e-3 : i->expected.values[fmu.internal_step];
}

static int legal_step(struct sequence *s, struct instance *i)
{
    const struct expected *e = &i->expected;
    const double size = internal_step(i) * between(s, 0.1, 12.0);
    const double time = e->time == e->time ? e->time : 0.0;
    enum outcome outcome = legal_if_tame(i, legal_in(i, RUNNING));
    const double over = time + size - e->last;
    if (outcome != FAILS && over > 0.0)
        outcome = over > 1e-6 ? FAILS : MAY_FAIL; /* between them is the allowed rounding */
    return step(s, i, time, size, outcome);
}

static void initialise(struct sequence *s, struct instance *i)
{
    struct values list;
    setup(s, i, 0.0, HUGE_VAL, SUCCEEDS);
    enter(s, i);
    choose_usual(s, i, &list);
    set(s, i, &list, SUCCEEDS);
    leave(s, i);
}

/* Read inputs and parameters back: the bits that were set. */
static void compare_values(struct sequence *s, struct instance *i)
{
    for (int k = 0; k < fmu.count; k++)
        if (can_be_set(k)) {
            double value;
            if (fmu.call.GetReal(i->component, &fmu.variables[k].reference, 1, &value) != fmi2OK
                || memcmp(&value, &i->expected.values[k], sizeof value) != 0)
                fault(s, "variable %u is not %.17g", fmu.variables[k].reference,
                      i->expected.values[k]);
        }
}

static fmi2FMUstate get_state(struct sequence *s, struct instance *i)
{
    fmi2FMUstate state = NULL;
    calling(s, "%s: fmi2GetFMUstate", i->name);
    if (is_refused(s, fmu.call.GetFMUstate(i->component, &state)) || !state)
        fault(s, "gives no state");
    return state;
}

/* Restore a state: in a sound instance values and outputs are those of the time of saving. */
static void restore(struct sequence *s, struct instance *i, const struct saved *saved)
{
    double outputs[OUTPUTS];
    calling(s, "%s: fmi2SetFMUstate of %p", i->name, saved->state);
    const int refused = is_refused(s, fmu.call.SetFMUstate(i->component, saved->state));
    if (saved->expected.failed) {
        i->expected = saved->expected;
        probe(s, i);
        return;
    }
    if (refused)
        fault(s, "a good state is refused");
    i->expected = saved->expected;
    if (i->expected.phase < RUNNING)
        return; /* outputs are worked out when they are asked for */
    compare_values(s, i);
    if (get_outputs(s, i, outputs)
        && memcmp(outputs, saved->outputs, (size_t)fmu.output_count * sizeof *outputs) != 0)
        fault(s, "outputs differ from those at the time of saving");
}

struct bytes {
    char *bytes; /* of exactly this size, so that a sanitizer sees one too many */
    size_t size;
};

static struct bytes serialise(struct sequence *s, struct instance *i, fmi2FMUstate state)
{
    struct bytes found = {NULL, 0};
    calling(s, "%s: fmi2SerializeFMUstate", i->name);
    if (is_refused(s, fmu.call.SerializedFMUstateSize(i->component, state, &found.size)))
        fault(s, "the size is refused");
    found.bytes = malloc(found.size);
    if (is_refused(s, fmu.call.SerializeFMUstate(i->component, state, found.bytes, found.size)))
        fault(s, "refused");
    digest(s, found.bytes, found.size);
    if (s->digest == 0) /* never; but here valgrind sees whether every byte was written */
        fault(s, "a digest of 0");
    return found;
}

/* The state after a way through bytes. */
static fmi2FMUstate by_bytes(struct sequence *s, struct instance *i, fmi2FMUstate state)
{
    struct bytes bytes = serialise(s, i, state);
    fmi2FMUstate again = chance(s, 0.5) ? NULL : s; /* only written, says the standard */
    calling(s, "%s: fmi2DeSerializeFMUstate", i->name);
    if (is_refused(s, fmu.call.DeSerializeFMUstate(i->component, bytes.bytes, bytes.size, &again)))
        fault(s, "good bytes are refused");
    free(bytes.bytes);
    if (is_refused(s, fmu.call.FreeFMUstate(i->component, &state)))
        fault(s, "a state cannot be freed");
    return again;
}

/* ---- replay: the same inputs and steps give the same bits ----------------------------------- */

struct trail {
    int rows; /* steps that succeeded */
    double outputs[SCRIPT][OUTPUTS];
};

/* Calls that change nothing in an instance; a step of another one is among them. */
static void look_around(struct sequence *s, struct instance *i)
{
    const struct variable *known;
    struct instance *other;
    fmi2FMUstate state;
    double value, one = 1.0;
    switch (below(s, 5)) {
    case 0:
        state = get_state(s, i);
        if (is_refused(s, fmu.call.FreeFMUstate(i->component, &state)))
            fault(s, "a state cannot be freed");
        break;
    case 1:
        compare_values(s, i);
        break;
    case 2:
        calling(s, "%s: fmi2GetRealStatus", i->name);
        is_refused(s, fmu.call.GetRealStatus(i->component, fmi2LastSuccessfulTime, &value));
        break;
    case 3:
        other = any_instance(s);
        if (other != i)
            legal_step(s, other);
        break;
    default:
        known = &fmu.variables[below(s, fmu.count)];
        if (!fmu.has_derivatives || known->kind == OUTPUT || known->kind == FLAG)
            return;
        calling(s, "%s: fmi2GetDirectionalDerivative by %u", i->name, known->reference);
        if (!is_refused(s, fmu.call.GetDirectionalDerivative(
                               i->component, &fmu.variables[fmu.outputs[0]].reference, 1,
                               &known->reference, 1, &one, &value))
            && !isfinite(value))
            fault(s, "a derivative of %g", value);
    }
}

/* Set inputs and step, as the script of this seed says; "curious" looks around in between. */
static void follow(struct sequence *s, struct instance *i, uint64_t script, int curious,
                   struct trail *trail)
{
    const uint64_t dice = s->random;
    uint64_t dice_of_the_curious = dice ^ script;
    struct values list;
    trail->rows = 0;
    s->random = script;
    for (int row = below(s, SCRIPT) + 1; row > 0 && !i->expected.failed; row--) {
        choose_usual(s, i, &list);
        set(s, i, &list, SUCCEEDS);
        if (curious) {
            const uint64_t dice_of_the_script = s->random;
            s->random = dice_of_the_curious;
            look_around(s, i);
            dice_of_the_curious = s->random;
            s->random = dice_of_the_script;
        }
        if (legal_step(s, i) && get_outputs(s, i, trail->outputs[trail->rows]))
            trail->rows++;
    }
    s->random = dice;
}

static void compare_trails(struct sequence *s, const struct trail *one, const struct trail *two)
{
    if (one->rows != two->rows)
        fault(s, "%d steps succeed, then %d in the replay", one->rows, two->rows);
    for (int row = 0; row < one->rows; row++)
        for (int k = 0; k < fmu.output_count; k++)
            if (memcmp(&one->outputs[row][k], &two->outputs[row][k], sizeof(double)) != 0)
                fault(s, "output %u after step %d is %.17g, and %.17g in the replay",
                      fmu.variables[fmu.outputs[k]].reference, row + 1, one->outputs[row][k],
                      two->outputs[row][k]);
}

static struct instance *another_instance(struct sequence *s, struct instance *i)
{
    struct instance *place = free_place(s);
    return !place ? any_instance(s) : chance(s, 0.5) ? i : instantiate(s, place);
}

static void replay_from_state(struct sequence *s, struct instance *i)
{
    struct trail trails[2];
    struct saved here;
    const uint64_t script = random_bits(s);
    if (!i->expected.failed && i->expected.phase == RUNNING) {
        here.expected = i->expected;
        here.state = get_state(s, i);
        get_outputs(s, i, here.outputs);
        if (chance(s, 0.5))
            here.state = by_bytes(s, i, here.state);
        follow(s, i, script, 0, &trails[0]);
        i = another_instance(s, i);
        restore(s, i, &here);
        follow(s, i, script, 1, &trails[1]);
        compare_trails(s, &trails[0], &trails[1]);
        calling(s, "%s: fmi2FreeFMUstate", i->name);
        if (is_refused(s, fmu.call.FreeFMUstate(i->component, &here.state)))
            fault(s, "refused");
    }
}

static void replay_from_start(struct sequence *s, struct instance *i)
{
    struct trail trails[2];
    const uint64_t script = random_bits(s), begin = s->random;
    reset(s, i);
    initialise(s, i);
    follow(s, i, script, 0, &trails[0]);
    const uint64_t dice = s->random;
    i = another_instance(s, i);
    reset(s, i);
    s->random = begin;
    initialise(s, i);
    s->random = dice;
    follow(s, i, script, 1, &trails[1]);
    compare_trails(s, &trails[0], &trails[1]);
}
