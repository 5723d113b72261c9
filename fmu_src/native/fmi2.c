/* FMI 2.0 co-simulation: every call of the standard, handed to instance.c.
 *
 * This is the one file to compile; it takes in the others.  The headers of FMI 2.0 come with the
 * importing tool, as the standard has it.
 */
#include <string.h>

#include "fmi2Functions.h"

#include "arithmetic.h"
#include "identity.h"
#include "model.c"

#define NUMBER "Real"
#define LAST_REFERENCE (VARIABLES - 1)
#include "instance.c"

/* An instance and how its host is told. */
typedef struct {
    Instance *core;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    int logging;
    char name[]; /* ends with a zero */
} Component;

/* A host prints a message as a printf format, so each % becomes two.  Many show no lines of the
 * logger unless asked, so without one the message goes to standard error. */
static void tell(void *host, int is_warning, const char *message)
{
    Component *c = host;
    char escaped[2 * MESSAGE];
    size_t n = 0;
    if (!c->logging || !c->logger) {
        fprintf(stderr, "%s: %s\n", c->name, message);
        return;
    }
    for (; *message && n + 2 < sizeof escaped; message++) {
        escaped[n++] = *message;
        if (*message == '%')
            escaped[n++] = '%';
    }
    escaped[n] = '\0';
    c->logger(c->environment, c->name, is_warning ? fmi2Warning : fmi2Error,
              is_warning ? "logStatusWarning" : "logStatusError", escaped);
}

static fmi2Status status(int good)
{
    return good ? fmi2OK : fmi2Error;
}

/* The instance behind a handle, NULL for none, of which standard error is told alone. */
static Instance *core(fmi2Component component, const char *call)
{
    if (!component)
        fprintf(stderr, "%s without an instance (NULL)\n", call);
    return component ? ((Component *)component)->core : NULL;
}

/* Without an instance, or without an array, the call is refused. */
#define CORE(array_is_there)                                                   \
    Instance *I = core(c, __func__);                                           \
    if (!I)                                                                    \
        return fmi2Error;                                                      \
    if (!(array_is_there))                                                     \
    return status(fail(I, "%s: an array is missing (NULL)", __func__))

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* Set which messages the host wants: all of them, or those of the categories. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                               const fmi2String names[])
{
    CORE(!count || names);
    if (!are_categories(I, names, count))
        return fmi2Error;
    ((Component *)c)->logging = on;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    const size_t length = name ? strlen(name) : 0;
    Component *c = calloc(1, sizeof *c + length + 2);
    (void)resources;
    (void)visible;
    if (!c) {
        fprintf(stderr, "%s: fmi2Instantiate: no memory for an instance\n", length ? name : "?");
        return NULL;
    }
    memcpy(c->name, length ? name : "?", length ? length : 1);
    c->logger = functions ? functions->logger : NULL;
    c->environment = functions ? functions->componentEnvironment : NULL;
    c->logging = logging;
    if (!functions)
        tell(c, 0, "fmi2Instantiate without callback functions (NULL): give them");
    else if (!length)
        tell(c, 0, "fmi2Instantiate without an instance name: give one");
    else if (type != fmi2CoSimulation)
        tell(c, 0, "this FMU is for co-simulation only, not for model exchange");
    else if (!guid || strcmp(guid, GUID) != 0)
        tell(c, 0, "the GUID is not that of this library: modelDescription.xml and the library are"
                   " from two builds; unpack the FMU again");
    else if (!(c->core = new_instance(tell, c)))
        tell(c, 0, "fmi2Instantiate: no memory for an instance");
    if (!c->core) {
        free(c);
        return NULL;
    }
    return c;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c) {
        free(((Component *)c)->core);
        free(c);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean stops,
                               fmi2Real stop)
{
    CORE(1);
    (void)tolerance_defined;
    (void)tolerance;
    return status(setup_experiment(I, "fmi2SetupExperiment", start, stops, stop));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    CORE(1);
    return status(enter_initialisation(I, "fmi2EnterInitializationMode"));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    CORE(1);
    return status(exit_initialisation(I, "fmi2ExitInitializationMode"));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    CORE(1);
    return status(terminate(I, "fmi2Terminate"));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    CORE(1);
    reset(I);
    return fmi2OK;
}

/* ---- variables -------------------------------------------------------------------------- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[])
{
    size_t i;
    CORE(!count || (references && values));
    if (!can_read(I, references, count, 0))
        return fmi2Error;
    for (i = 0; i < count; i++)
        values[i] = I->now.values[references[i]];
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference references[], size_t count,
                          fmi2Boolean values[])
{
    size_t i;
    CORE(!count || (references && values));
    if (!can_read(I, references, count, 1))
        return fmi2Error;
    for (i = 0; i < count; i++)
        values[i] = I->now.values[references[i]] != 0.0;
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[])
{
    CORE(!count || (references && values));
    return status(set_values(I, references, count, values));
}

/* No variable has these types, and no Boolean can be set. */
#define NO_SUCH_TYPE(function, type, c_type)                                                  \
    fmi2Status function(fmi2Component c, const fmi2ValueReference references[], size_t count, \
                        c_type values[])                                                      \
    {                                                                                         \
        CORE(1);                                                                              \
        (void)references;                                                                     \
        (void)values;                                                                         \
        return status(no_such_type(I, type, count));                                          \
    }

NO_SUCH_TYPE(fmi2GetInteger, "Integer", fmi2Integer)
NO_SUCH_TYPE(fmi2GetString, "String", fmi2String)
NO_SUCH_TYPE(fmi2SetInteger, "Integer", const fmi2Integer)
NO_SUCH_TYPE(fmi2SetBoolean, "Boolean", const fmi2Boolean)
NO_SUCH_TYPE(fmi2SetString, "String", const fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[],
                                        size_t count, const fmi2ValueReference knowns[],
                                        size_t directions, const fmi2Real seed[],
                                        fmi2Real result[])
{
    CORE((!count || (unknowns && result)) && (!directions || (knowns && seed)));
    switch (derive(I, "fmi2GetDirectionalDerivative", unknowns, count, knowns, directions, 0,
                   seed, result)) {
    case DERIVED:
        return fmi2OK;
    case NOT_SMOOTH:
        return fmi2Discard;
    default:
        return fmi2Error;
    }
}

/* ---- co-simulation ---------------------------------------------------------------------- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference references[],
                                       size_t count, const fmi2Integer orders[],
                                       const fmi2Real values[])
{
    CORE(1);
    (void)references;
    (void)orders;
    (void)values;
    return status(no_such_type(I, "derivative of an input", count));
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference references[],
                                        size_t count, const fmi2Integer orders[],
                                        fmi2Real values[])
{
    CORE(1);
    (void)references;
    (void)orders;
    (void)values;
    return status(no_such_type(I, "derivative of an output", count));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_way_back)
{
    CORE(1);
    (void)no_way_back;
    return status(do_step(I, "fmi2DoStep", time, size));
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    CORE(1);
    return status(refuse(I, "fmi2CancelStep: a step ends before fmi2DoStep returns"));
}

static fmi2Status no_answer(Instance *I, const char *call, fmi2StatusKind kind)
{
    refuse(I, "%s of kind %d: there is no answer", call, (int)kind);
    return fmi2Discard;
}

/* A step is never pending, so there is nothing to ask about but the time reached. */
#define NO_STATUS(function, c_type)                                              \
    fmi2Status function(fmi2Component c, const fmi2StatusKind kind, c_type *value) \
    {                                                                            \
        CORE(value);                                                             \
        return no_answer(I, __func__, kind);                                     \
    }

NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    CORE(value);
    if (kind != fmi2LastSuccessfulTime || I->now.phase != RUNNING || I->now.trouble[0])
        return no_answer(I, __func__, kind);
    *value = I->now.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    CORE(value);
    if (kind != fmi2Terminated)
        return no_answer(I, __func__, kind);
    *value = fmi2False; /* the FMU never ends a run by itself */
    return fmi2OK;
}

/* ---- saved states ----------------------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    CORE(state);
    return status(keep(I, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    CORE(1);
    return status(restore(I, "fmi2SetFMUstate", state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    CORE(1);
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    CORE(state && size);
    *size = sizeof(Saved);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size)
{
    CORE(state && bytes);
    return status(serialise(I, state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    CORE(bytes && state);
    return status(deserialise(I, bytes, size, state));
}
