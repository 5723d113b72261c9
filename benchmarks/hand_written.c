/* An FMI 2.0 co-simulation FMU written by hand: the yardstick of speed for the generated ones.
 *
 * equations.h is hand_written_torque_motor.h or hand_written_sg90.h.  Classical Runge-Kutta in equal
 * sub-steps of at most internal_step; the value references are those of the generated FMU.  There is
 * nothing else: no effects, stops or friction, no error control, no bounds, no GUID check. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "equations.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* the standard gives more than is used */

typedef struct {
    double value[PLACES];
    State x;
    int stale; /* a parameter was set, and what follows from it is old */
} Instance;

static void step(Instance *m, double size)
{
    int wanted = (int)ceil(size / m->value[INTERNAL_STEP] - 1e-6);
    int n = wanted < 1 ? 1 : wanted;
    double h = size / n;
    State x = m->x;
    for (int i = 0; i < n; ++i)
        x = sub_step(m->value, x, h);
    m->x = x;
}

static void update(Instance *m)
{
    if (m->stale)
        prepare(m->value);
    m->stale = 0;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *m = type == fmi2CoSimulation ? malloc(sizeof *m) : NULL;
    if (m)
        fmi2Reset(m);
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2Reset(fmi2Component c)
{
    Instance *m = c;
    for (int i = 0; i < VARIABLES; ++i)
        m->value[i] = start[i];
    memset(&m->x, 0, sizeof m->x);
    m->stale = 1;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
    fmi2Real begin, fmi2Boolean has_end, fmi2Real end)
{
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Instance *m = c;
    update(m);
    look(m->value, m->x);
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[])
{
    Instance *m = c;
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] >= VARIABLES || (vr[i] >= FIRST_OUTPUT && vr[i] < INTERNAL_STEP))
            return fmi2Error;
        m->value[vr[i]] = v[i];
        m->stale |= vr[i] >= INTERNAL_STEP;
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[])
{
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] >= VARIABLES || vr[i] == FLAG)
            return fmi2Error;
        v[i] = ((Instance *)c)->value[vr[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean v[])
{
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] != FLAG)
            return fmi2Error;
        v[i] = ((Instance *)c)->value[FLAG] != 0.0;
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real size, fmi2Boolean no_return)
{
    Instance *m = c;
    if (!(size > 0.0))
        return fmi2Error;
    update(m);
    step(m, size);
    look(m->value, m->x);
    return isfinite(m->x.angle) ? fmi2OK : fmi2Error;
}

/* What a small FMU declines. */
#define DECLINED(name, ...) fmi2Status name(__VA_ARGS__) { return fmi2Error; }
#define REFERENCES fmi2Component c, const fmi2ValueReference vr[], size_t n
#define STATUS fmi2Component c, const fmi2StatusKind kind
DECLINED(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
DECLINED(fmi2GetInteger, REFERENCES, fmi2Integer v[])
DECLINED(fmi2GetString, REFERENCES, fmi2String v[])
DECLINED(fmi2SetInteger, REFERENCES, const fmi2Integer v[])
DECLINED(fmi2SetBoolean, REFERENCES, const fmi2Boolean v[])
DECLINED(fmi2SetString, REFERENCES, const fmi2String v[])
DECLINED(fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *state)
DECLINED(fmi2SetFMUstate, fmi2Component c, fmi2FMUstate state)
DECLINED(fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *state)
DECLINED(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size)
DECLINED(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
DECLINED(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t size,
    fmi2FMUstate *state)
DECLINED(fmi2GetDirectionalDerivative, REFERENCES, const fmi2ValueReference known[], size_t m,
    const fmi2Real dv[], fmi2Real v[])
DECLINED(fmi2SetRealInputDerivatives, REFERENCES, const fmi2Integer order[], const fmi2Real v[])
DECLINED(fmi2GetRealOutputDerivatives, REFERENCES, const fmi2Integer order[], fmi2Real v[])
DECLINED(fmi2CancelStep, fmi2Component c)
DECLINED(fmi2GetStatus, STATUS, fmi2Status *v)
DECLINED(fmi2GetRealStatus, STATUS, fmi2Real *v)
DECLINED(fmi2GetIntegerStatus, STATUS, fmi2Integer *v)
DECLINED(fmi2GetBooleanStatus, STATUS, fmi2Boolean *v)
DECLINED(fmi2GetStringStatus, STATUS, fmi2String *v)
