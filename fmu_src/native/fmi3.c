/* FMI 3.0 co-simulation: every call of the standard, handed to instance.c.
 *
 * This is the one file to compile; it takes in the others.  The headers of FMI 3.0 come with the
 * importing tool, as the standard has it.  Clocks, events, early return, intermediate update, arrays
 * and configuration are left out, which modelDescription.xml says; their calls are refused.
 */
#include <string.h>

#include "fmi3Functions.h"

#include "arithmetic.h"
#include "identity.h"
#include "model.c"

#define NUMBER "Float64"
#define TIME VARIABLES /* value reference of the independent variable */
#define LAST_REFERENCE TIME
#include "instance.c"

/* An instance and how its host is told. */
typedef struct {
    Instance *core;
    fmi3LogMessageCallback logger;
    fmi3InstanceEnvironment environment;
    int logging;
    char name[]; /* ends with a zero */
} Component;

/* Many hosts show no lines of the logger unless asked, so without one the message goes to standard
 * error. */
static void tell(void *host, int is_warning, const char *message)
{
    Component *c = host;
    if (c->logging && c->logger)
        c->logger(c->environment, is_warning ? fmi3Warning : fmi3Error,
                  is_warning ? "logStatusWarning" : "logStatusError", message);
    else
        fprintf(stderr, "%s: %s\n", c->name, message);
}

static fmi3Status status(int good)
{
    return good ? fmi3OK : fmi3Error;
}

/* The instance behind a handle, NULL for none, of which standard error is told alone. */
static Instance *core(fmi3Instance component, const char *call)
{
    if (!component)
        fprintf(stderr, "%s without an instance (NULL)\n", call);
    return component ? ((Component *)component)->core : NULL;
}

/* Without an instance, or without an array or a place for a result, the call is refused. */
#define CORE(arguments_are_there)                                              \
    Instance *I = core(c, __func__);                                           \
    if (!I)                                                                    \
        return fmi3Error;                                                      \
    if (!(arguments_are_there))                                                \
    return status(fail(I, "%s: an argument is missing (NULL)", __func__))

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* Set which messages the host wants: all of them, or those of the categories. */
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count,
                               const fmi3String names[])
{
    CORE(!count || names);
    if (!are_categories(I, names, count))
        return fmi3Error;
    ((Component *)c)->logging = on;
    return fmi3OK;
}

/* ---- the life of an instance ------------------------------------------------------------ */

static Component *new_component(fmi3String name, int logging, fmi3InstanceEnvironment environment,
                                fmi3LogMessageCallback logger)
{
    const size_t length = name ? strlen(name) : 0;
    Component *c = calloc(1, sizeof *c + length + 2);
    if (!c) {
        fprintf(stderr, "%s: no memory for an instance\n", length ? name : "?");
        return NULL;
    }
    memcpy(c->name, length ? name : "?", length ? length : 1);
    c->logger = logger;
    c->environment = environment;
    c->logging = logging;
    return c;
}

static fmi3Instance no_instance(Component *c, const char *why)
{
    if (c)
        tell(c, 0, why);
    free(c);
    return NULL;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
    fmi3IntermediateUpdateCallback update)
{
    Component *c = new_component(name, logging, environment, logger);
    (void)resources;
    (void)visible;
    (void)early_return;
    (void)intermediate;
    (void)update;
    if (!c)
        return NULL;
    if (!name || !*name)
        return no_instance(c, "fmi3InstantiateCoSimulation without an instance name: give one");
    if (!token || strcmp(token, GUID) != 0)
        return no_instance(c, "the instantiation token is not that of this library:"
                              " modelDescription.xml and the library are from two builds; unpack"
                              " the FMU again");
    if (events)
        return no_instance(c, "this FMU has no event mode: instantiate it without");
    if (intermediates)
        return no_instance(c, "this FMU has no intermediate update: ask for no variables of it");
    c->core = new_instance(tell, c);
    if (!c->core)
        return no_instance(c, "no memory for an instance");
    return c;
}

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    (void)token;
    (void)resources;
    (void)visible;
    return no_instance(new_component(name, logging, environment, logger),
                       "this FMU is for co-simulation only, not for model exchange");
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)token;
    (void)resources;
    (void)visible;
    (void)update;
    (void)lock;
    (void)unlock;
    return no_instance(new_component(name, logging, environment, logger),
                       "this FMU is for co-simulation only, not for scheduled execution");
}

void fmi3FreeInstance(fmi3Instance c)
{
    if (c) {
        free(((Component *)c)->core);
        free(c);
    }
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined,
                                       fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stops,
                                       fmi3Float64 stop)
{
    CORE(1);
    (void)tolerance_defined;
    (void)tolerance;
    return status(setup_experiment(I, "fmi3EnterInitializationMode", start, stops, stop)
                  && enter_initialisation(I, "fmi3EnterInitializationMode"));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    CORE(1);
    return status(exit_initialisation(I, "fmi3ExitInitializationMode"));
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    CORE(1);
    return status(terminate(I, "fmi3Terminate"));
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    CORE(1);
    reset(I);
    return fmi3OK;
}

/* ---- variables -------------------------------------------------------------------------- */

/* Every variable is a scalar, so there is one value for each. */
static int fit(Instance *I, const char *call, size_t values, size_t count)
{
    return values == count
        || fail(I, "%s: %lu values for %lu variables, each of which has one", call,
                (unsigned long)values, (unsigned long)count);
}

static int without_time(Instance *I, const char *call, const fmi3ValueReference *references,
                        size_t count)
{
    size_t i;
    for (i = 0; i < count; i++)
        if (references[i] == TIME)
            return fail(I, "%s: value reference %d is time, which can only be read, by"
                           " fmi3GetFloat64", call, TIME);
    return 1;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                          fmi3Float64 values[], size_t size)
{
    size_t i;
    CORE(!count || (references && values));
    if (!fit(I, __func__, size, count) || !can_read(I, references, 0, 0))
        return fmi3Error;
    for (i = 0; i < count; i++)
        if (references[i] != TIME && !can_read(I, references + i, 1, 0))
            return fmi3Error;
    for (i = 0; i < count; i++)
        values[i] = references[i] != TIME ? I->now.values[references[i]]
            : begun(I) ? I->now.time : I->now.begins;
    return fmi3OK;
}

fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                          fmi3Boolean values[], size_t size)
{
    size_t i;
    CORE(!count || (references && values));
    if (!fit(I, __func__, size, count) || !without_time(I, __func__, references, count)
        || !can_read(I, references, count, 1))
        return fmi3Error;
    for (i = 0; i < count; i++)
        values[i] = I->now.values[references[i]] != 0.0;
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                          const fmi3Float64 values[], size_t size)
{
    CORE(!count || (references && values));
    return status(fit(I, __func__, size, count) && without_time(I, __func__, references, count)
                  && set_values(I, references, count, values));
}

/* No variable has these types, and no Boolean can be set. */
#define NO_SUCH_TYPE(function, type, c_type)                                                  \
    fmi3Status function(fmi3Instance c, const fmi3ValueReference references[], size_t count,  \
                        c_type values[], size_t size)                                         \
    {                                                                                         \
        CORE(1);                                                                              \
        (void)references;                                                                     \
        (void)values;                                                                         \
        (void)size;                                                                           \
        return status(no_such_type(I, type, count));                                          \
    }

NO_SUCH_TYPE(fmi3GetFloat32, "Float32", fmi3Float32)
NO_SUCH_TYPE(fmi3GetInt8, "Int8", fmi3Int8)
NO_SUCH_TYPE(fmi3GetUInt8, "UInt8", fmi3UInt8)
NO_SUCH_TYPE(fmi3GetInt16, "Int16", fmi3Int16)
NO_SUCH_TYPE(fmi3GetUInt16, "UInt16", fmi3UInt16)
NO_SUCH_TYPE(fmi3GetInt32, "Int32", fmi3Int32)
NO_SUCH_TYPE(fmi3GetUInt32, "UInt32", fmi3UInt32)
NO_SUCH_TYPE(fmi3GetInt64, "Int64", fmi3Int64)
NO_SUCH_TYPE(fmi3GetUInt64, "UInt64", fmi3UInt64)
NO_SUCH_TYPE(fmi3GetString, "String", fmi3String)
NO_SUCH_TYPE(fmi3SetFloat32, "Float32", const fmi3Float32)
NO_SUCH_TYPE(fmi3SetInt8, "Int8", const fmi3Int8)
NO_SUCH_TYPE(fmi3SetUInt8, "UInt8", const fmi3UInt8)
NO_SUCH_TYPE(fmi3SetInt16, "Int16", const fmi3Int16)
NO_SUCH_TYPE(fmi3SetUInt16, "UInt16", const fmi3UInt16)
NO_SUCH_TYPE(fmi3SetInt32, "Int32", const fmi3Int32)
NO_SUCH_TYPE(fmi3SetUInt32, "UInt32", const fmi3UInt32)
NO_SUCH_TYPE(fmi3SetInt64, "Int64", const fmi3Int64)
NO_SUCH_TYPE(fmi3SetUInt64, "UInt64", const fmi3UInt64)
NO_SUCH_TYPE(fmi3SetBoolean, "Boolean", const fmi3Boolean)
NO_SUCH_TYPE(fmi3SetString, "String", const fmi3String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                         size_t sizes[], fmi3Binary values[], size_t size)
{
    CORE(1);
    (void)references;
    (void)sizes;
    (void)values;
    (void)size;
    return status(no_such_type(I, "Binary", count));
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                         const size_t sizes[], const fmi3Binary values[], size_t size)
{
    CORE(1);
    (void)references;
    (void)sizes;
    (void)values;
    (void)size;
    return status(no_such_type(I, "Binary", count));
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference references[],
                                    size_t count, const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t size)
{
    CORE(1);
    (void)references;
    (void)orders;
    (void)values;
    (void)size;
    return status(no_such_type(I, "derivative of an output", count));
}

/* ---- partial derivatives ---------------------------------------------------------------- */

static fmi3Status differentiate(Instance *I, const char *call,
                                const fmi3ValueReference *unknowns, size_t count,
                                const fmi3ValueReference *knowns, size_t directions, int adjoint,
                                const fmi3Float64 *seed, size_t seeds, fmi3Float64 *result,
                                size_t results)
{
    if (!fit(I, call, seeds, adjoint ? count : directions)
        || !fit(I, call, results, adjoint ? directions : count)
        || !without_time(I, call, unknowns, count) || !without_time(I, call, knowns, directions))
        return fmi3Error;
    switch (derive(I, call, unknowns, count, knowns, directions, adjoint, seed, result)) {
    case DERIVED:
        return fmi3OK;
    case NOT_SMOOTH:
        return fmi3Discard;
    default:
        return fmi3Error;
    }
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[],
                                        size_t count, const fmi3ValueReference knowns[],
                                        size_t directions, const fmi3Float64 seed[], size_t seeds,
                                        fmi3Float64 result[], size_t results)
{
    CORE((!count || (unknowns && result)) && (!directions || (knowns && seed)));
    return differentiate(I, "fmi3GetDirectionalDerivative", unknowns, count, knowns, directions, 0,
                         seed, seeds, result, results);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[],
                                    size_t count, const fmi3ValueReference knowns[],
                                    size_t directions, const fmi3Float64 seed[], size_t seeds,
                                    fmi3Float64 result[], size_t results)
{
    CORE((!count || (unknowns && seed)) && (!directions || (knowns && result)));
    return differentiate(I, "fmi3GetAdjointDerivative", unknowns, count, knowns, directions, 1,
                         seed, seeds, result, results);
}

/* ---- co-simulation ---------------------------------------------------------------------- */

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_way_back,
                      fmi3Boolean *has_event, fmi3Boolean *ends_run, fmi3Boolean *is_early,
                      fmi3Float64 *reached)
{
    CORE(has_event && ends_run && is_early && reached);
    (void)no_way_back;
    *has_event = *ends_run = *is_early = fmi3False;
    *reached = I->now.time;
    if (!do_step(I, "fmi3DoStep", time, size))
        return fmi3Error;
    *reached = I->now.time;
    return fmi3OK;
}

/* ---- saved states ----------------------------------------------------------------------- */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    CORE(state);
    return status(keep(I, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    CORE(1);
    return status(restore(I, "fmi3SetFMUState", state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    CORE(1);
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    CORE(state && size);
    *size = sizeof(Saved);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size)
{
    CORE(state && bytes);
    return status(serialise(I, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
    CORE(bytes && state);
    return status(deserialise(I, bytes, size, state));
}

/* ---- what this FMU has not -------------------------------------------------------------- */

/* A call that changes nothing and is refused; importers load every function of the standard. */
#define REFUSED(function, parameters, ignored, why)      \
    fmi3Status function parameters                       \
    {                                                    \
        CORE(1);                                         \
        ignored;                                         \
        return status(refuse(I, "%s: %s", #function, why)); \
    }
#define NOTHING (void)0
#define IGNORED(a) (void)a
#define IGNORED2(a, b) IGNORED(a), IGNORED(b)
#define IGNORED3(a, b, c) IGNORED2(a, b), IGNORED(c)
#define IGNORED6(a, b, c, d, e, f) IGNORED3(a, b, c), IGNORED3(d, e, f)

#define NO_EVENTS "this FMU has no event mode: it is between steps once fmi3ExitInitializationMode" \
                  " returns"
REFUSED(fmi3EnterEventMode, (fmi3Instance c), NOTHING, NO_EVENTS)
REFUSED(fmi3EnterStepMode, (fmi3Instance c), NOTHING, NO_EVENTS)
REFUSED(fmi3EvaluateDiscreteStates, (fmi3Instance c), NOTHING, NO_EVENTS)
REFUSED(fmi3UpdateDiscreteStates,
        (fmi3Instance c, fmi3Boolean *again, fmi3Boolean *ends_run, fmi3Boolean *nominals,
         fmi3Boolean *values, fmi3Boolean *has_next, fmi3Float64 *next),
        IGNORED6(again, ends_run, nominals, values, has_next, next), NO_EVENTS)

#define NO_CONFIGURATION "this FMU has no structural parameters"
REFUSED(fmi3EnterConfigurationMode, (fmi3Instance c), NOTHING, NO_CONFIGURATION)
REFUSED(fmi3ExitConfigurationMode, (fmi3Instance c), NOTHING, NO_CONFIGURATION)

#define NO_DEPENDENCIES "modelDescription.xml has the dependencies, which do not change"
REFUSED(fmi3GetNumberOfVariableDependencies,
        (fmi3Instance c, fmi3ValueReference reference, size_t *count), IGNORED2(reference, count),
        NO_DEPENDENCIES)
REFUSED(fmi3GetVariableDependencies,
        (fmi3Instance c, fmi3ValueReference reference, size_t elements[],
         fmi3ValueReference knowns[], size_t known_elements[], fmi3DependencyKind kinds[],
         size_t count),
        IGNORED6(reference, elements, knowns, known_elements, kinds, count), NO_DEPENDENCIES)

#define CLOCKS fmi3Instance c, const fmi3ValueReference references[], size_t count
#define NO_CLOCK "this FMU has no clocks"
REFUSED(fmi3GetClock, (CLOCKS, fmi3Clock values[]), IGNORED3(references, count, values), NO_CLOCK)
REFUSED(fmi3SetClock, (CLOCKS, const fmi3Clock values[]), IGNORED3(references, count, values),
        NO_CLOCK)
REFUSED(fmi3GetIntervalDecimal, (CLOCKS, fmi3Float64 a[], fmi3IntervalQualifier b[]),
        (IGNORED2(references, count), IGNORED2(a, b)), NO_CLOCK)
REFUSED(fmi3GetIntervalFraction,
        (CLOCKS, fmi3UInt64 a[], fmi3UInt64 b[], fmi3IntervalQualifier d[]),
        (IGNORED2(references, count), IGNORED3(a, b, d)), NO_CLOCK)
REFUSED(fmi3GetShiftDecimal, (CLOCKS, fmi3Float64 a[]), IGNORED3(references, count, a), NO_CLOCK)
REFUSED(fmi3GetShiftFraction, (CLOCKS, fmi3UInt64 a[], fmi3UInt64 b[]),
        (IGNORED2(references, count), IGNORED2(a, b)), NO_CLOCK)
REFUSED(fmi3SetIntervalDecimal, (CLOCKS, const fmi3Float64 a[]), IGNORED3(references, count, a),
        NO_CLOCK)
REFUSED(fmi3SetIntervalFraction, (CLOCKS, const fmi3UInt64 a[], const fmi3UInt64 b[]),
        (IGNORED2(references, count), IGNORED2(a, b)), NO_CLOCK)
REFUSED(fmi3SetShiftDecimal, (CLOCKS, const fmi3Float64 a[]), IGNORED3(references, count, a),
        NO_CLOCK)
REFUSED(fmi3SetShiftFraction, (CLOCKS, const fmi3UInt64 a[], const fmi3UInt64 b[]),
        (IGNORED2(references, count), IGNORED2(a, b)), NO_CLOCK)
REFUSED(fmi3ActivateModelPartition,
        (fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time), IGNORED2(clock, time),
        NO_CLOCK)

#define NO_EXCHANGE "this FMU is for co-simulation only, not for model exchange"
REFUSED(fmi3EnterContinuousTimeMode, (fmi3Instance c), NOTHING, NO_EXCHANGE)
REFUSED(fmi3CompletedIntegratorStep,
        (fmi3Instance c, fmi3Boolean no_way_back, fmi3Boolean *has_event, fmi3Boolean *ends_run),
        IGNORED3(no_way_back, has_event, ends_run), NO_EXCHANGE)
REFUSED(fmi3SetTime, (fmi3Instance c, fmi3Float64 time), IGNORED(time), NO_EXCHANGE)
REFUSED(fmi3SetContinuousStates, (fmi3Instance c, const fmi3Float64 values[], size_t count),
        IGNORED2(values, count), NO_EXCHANGE)
REFUSED(fmi3GetContinuousStates, (fmi3Instance c, fmi3Float64 values[], size_t count),
        IGNORED2(values, count), NO_EXCHANGE)
REFUSED(fmi3GetContinuousStateDerivatives, (fmi3Instance c, fmi3Float64 values[], size_t count),
        IGNORED2(values, count), NO_EXCHANGE)
REFUSED(fmi3GetEventIndicators, (fmi3Instance c, fmi3Float64 values[], size_t count),
        IGNORED2(values, count), NO_EXCHANGE)
REFUSED(fmi3GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 values[], size_t count),
        IGNORED2(values, count), NO_EXCHANGE)
REFUSED(fmi3GetNumberOfEventIndicators, (fmi3Instance c, size_t *count), IGNORED(count),
        NO_EXCHANGE)
REFUSED(fmi3GetNumberOfContinuousStates, (fmi3Instance c, size_t *count), IGNORED(count),
        NO_EXCHANGE)
