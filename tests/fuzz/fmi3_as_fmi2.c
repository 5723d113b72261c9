/* The FMU of FMI 3.0 behind the calls of FMI 2.0, so that fmi_calls.c plays its sequences on it.
 *
 * Each call is made of the ones that took its place.  What FMI 3.0 returns beside the status of a
 * step is checked here; calls of FMI 2.0 that have no successor make calls of FMI 3.0 that this FMU
 * does not support.
 */
#include "fmi3.c"

#include "fmi2Functions.h"

typedef struct {
    fmi3Instance core; /* NULL while it is made */
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    unsigned refused; /* calls that are not supported, so far */
    char name[];
} Host;

static void log_message(fmi3InstanceEnvironment environment, fmi3Status status,
                        fmi3String category, fmi3String message)
{
    Host *h = environment;
    h->logger(h->environment, h->name, (fmi2Status)status, category, "%s", message);
}

static fmi3Instance inside(fmi2Component c)
{
    return c ? ((Host *)c)->core : NULL;
}

static Instance *instance_of(fmi2Component c)
{
    return c ? ((Component *)inside(c))->core : NULL;
}

static fmi2Status told(fmi3Status status)
{
    return (fmi2Status)status; /* OK, Warning, Discard, Error and Fatal have the same numbers */
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return strcmp(fmi3GetVersion(), "3.0") == 0 ? "2.0" : fmi3GetVersion();
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                               const fmi2String names[])
{
    return told(fmi3SetDebugLogging(inside(c), on, count, names));
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    fmi3LogMessageCallback logger = functions && functions->logger ? log_message : NULL;
    const char *known = name ? name : "";
    Host *h = calloc(1, sizeof *h + strlen(known) + 2);
    if (!h) {
        fprintf(stderr, "no memory\n");
        return NULL;
    }
    memcpy(h->name, *known ? known : "?", *known ? strlen(known) : 1);
    h->logger = functions ? functions->logger : NULL;
    h->environment = functions ? functions->componentEnvironment : NULL;
    if (type == fmi2CoSimulation)
        h->core = fmi3InstantiateCoSimulation(name, guid, resources, visible, logging, fmi3False,
                                              fmi3False, NULL, 0, h, logger, NULL);
    else if (type == fmi2ModelExchange)
        h->core = fmi3InstantiateModelExchange(name, guid, resources, visible, logging, h, logger);
    else
        h->core = fmi3InstantiateScheduledExecution(name, guid, resources, visible, logging, h,
                                                    logger, NULL, NULL, NULL);
    if (!h->core) {
        free(h);
        return NULL;
    }
    return h;
}

void fmi2FreeInstance(fmi2Component c)
{
    fmi3FreeInstance(inside(c));
    free(c);
}

/* FMI 3.0 has this in fmi3EnterInitializationMode, which is given here what was set. */
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean stops, fmi2Real stop)
{
    if (!c)
        return told(fmi3EnterInitializationMode(NULL, tolerance_defined, tolerance, start, stops,
                                                stop));
    return told(status(setup_experiment(instance_of(c), "fmi2SetupExperiment", start, stops,
                                        stop)));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    const Instance *I = instance_of(c);
    const double start = I ? I->now.begins : 0.0, stop = I ? I->now.last : HUGE_VAL;
    return told(fmi3EnterInitializationMode(inside(c), fmi3False, 0.0, start, stop < HUGE_VAL,
                                            stop));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return told(fmi3ExitInitializationMode(inside(c)));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return told(fmi3Terminate(inside(c)));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    return told(fmi3Reset(inside(c)));
}

#define VALUES fmi2Component c, const fmi2ValueReference references[], size_t count

fmi2Status fmi2GetReal(VALUES, fmi2Real values[])
{
    return told(fmi3GetFloat64(inside(c), references, count, values, count));
}

fmi2Status fmi2SetReal(VALUES, const fmi2Real values[])
{
    return told(fmi3SetFloat64(inside(c), references, count, values, count));
}

fmi2Status fmi2GetBoolean(VALUES, fmi2Boolean values[])
{
    fmi3Boolean found[16];
    const fmi3Status status = fmi3GetBoolean(inside(c), references, count, values ? found : NULL,
                                             count);
    for (size_t i = 0; status == fmi3OK && i < count; i++)
        values[i] = found[i] ? fmi2True : fmi2False;
    return told(status);
}

fmi2Status fmi2SetBoolean(VALUES, const fmi2Boolean values[])
{
    const fmi3Boolean given[] = {values && values[0]};
    return told(fmi3SetBoolean(inside(c), references, count, values ? given : NULL, count));
}

fmi2Status fmi2GetInteger(VALUES, fmi2Integer values[])
{
    return told(fmi3GetInt32(inside(c), references, count, values, count));
}

fmi2Status fmi2SetInteger(VALUES, const fmi2Integer values[])
{
    return told(fmi3SetInt32(inside(c), references, count, values, count));
}

fmi2Status fmi2GetString(VALUES, fmi2String values[])
{
    return told(fmi3GetString(inside(c), references, count, values, count));
}

fmi2Status fmi2SetString(VALUES, const fmi2String values[])
{
    return told(fmi3SetString(inside(c), references, count, values, count));
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return told(fmi3GetFMUState(inside(c), state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return told(fmi3SetFMUState(inside(c), state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return told(fmi3FreeFMUState(inside(c), state));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    return told(fmi3SerializedFMUStateSize(inside(c), state, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return told(fmi3SerializeFMUState(inside(c), state, (fmi3Byte *)bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    return told(fmi3DeserializeFMUState(inside(c), (const fmi3Byte *)bytes, size, state));
}

/* With one variable on each side the adjoint derivative is the same number. */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[],
                                        size_t count, const fmi2ValueReference knowns[],
                                        size_t directions, const fmi2Real seed[], fmi2Real result[])
{
    double adjoint;
    const fmi3Status status = fmi3GetDirectionalDerivative(
        inside(c), unknowns, count, knowns, directions, seed, directions, result, count);
    if (status == fmi3OK && count == 1 && directions == 1
        && fmi3GetAdjointDerivative(inside(c), unknowns, 1, knowns, 1, seed, 1, &adjoint, 1)
            == fmi3OK /* else memory has run out */
        && adjoint != *result)
        abort();
    return told(status);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_way_back)
{
    fmi3Boolean has_event = fmi3True, ends_run = fmi3True, returns_early = fmi3True;
    double last = -1.0;
    const fmi3Status status = fmi3DoStep(inside(c), time, size, no_way_back, &has_event, &ends_run,
                                         &returns_early, &last);
    if (status == fmi3OK && (has_event || ends_run || returns_early || last != time + size))
        abort();
    return told(status);
}

/* Each time another call that this FMU does not support. */
static fmi2Status refused(fmi2Component c)
{
    fmi3Instance f = inside(c);
    const fmi3ValueReference reference = 0;
    switch (c ? ((Host *)c)->refused++ % 10 : 0) {
    case 0:
        return told(fmi3EnterEventMode(f));
    case 1:
        return told(fmi3EnterStepMode(f));
    case 2:
        return told(fmi3EnterConfigurationMode(f));
    case 3:
        return told(fmi3ExitConfigurationMode(f));
    case 4:
        return told(fmi3EvaluateDiscreteStates(f));
    case 5:
        return told(fmi3UpdateDiscreteStates(f, NULL, NULL, NULL, NULL, NULL, NULL));
    case 6:
        return told(fmi3GetClock(f, &reference, 1, NULL));
    case 7:
        return told(fmi3SetIntervalDecimal(f, &reference, 1, NULL));
    case 8:
        return told(fmi3EnterContinuousTimeMode(f));
    default:
        return told(fmi3GetNumberOfContinuousStates(f, NULL));
    }
}

fmi2Status fmi2SetRealInputDerivatives(VALUES, const fmi2Integer orders[], const fmi2Real values[])
{
    (void)references;
    (void)count;
    (void)orders;
    (void)values;
    return refused(c);
}

fmi2Status fmi2GetRealOutputDerivatives(VALUES, const fmi2Integer orders[], fmi2Real values[])
{
    return told(fmi3GetOutputDerivatives(inside(c), references, count, orders, values, count));
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refused(c);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind;
    (void)value;
    return refused(c);
}

/* The time is a variable of its own. */
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    const fmi3ValueReference time = TIME;
    if (c && (kind != fmi2LastSuccessfulTime || instance_of(c)->now.phase != RUNNING))
        return refused(c);
    return told(fmi3GetFloat64(inside(c), &time, 1, value, 1));
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind;
    (void)value;
    return refused(c);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    (void)kind;
    (void)value;
    return refused(c);
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind;
    (void)value;
    return refused(c);
}
