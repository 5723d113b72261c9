/* FMUs of another maker: small models behind FMI 2.0, or 3.0 with -DFMI3.
   The GUID says which one, "{lag}", and which fault is planted in it, "{lag/gain}".
   A variable is its value reference: real numbers from 0, integers from 100, truth values from
   200, texts from 300.  Inputs are at 0, outputs at 8, parameters at 16 of each. */

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef FMI3
#include "fmi3Functions.h"
#else
#include "fmi2Functions.h"
#endif

#define HISTORY 200000
#define PI 3.14159265358979323846

typedef struct Slave Slave;
typedef struct {
    const char *name;
    double inner; /* longest internal step */
    void (*start)(Slave *);
    void (*advance)(Slave *, double);
    void (*outputs)(Slave *);
} Model;

struct Slave {
    const Model *model;
    char fault[64], text[64];
    double r[32], x[8], t, step;
    int n[32], b[32];
    long steps;
    unsigned random;
    double *then, *was; /* times and values of the first output, or input */
    long kept;
};

static int is(const Slave *s, const char *fault) { return strcmp(s->fault, fault) == 0; }

/* The value of what was remembered, `delay` ago; lines between, or held. */
static double ago(const Slave *s, double delay, double now, int held)
{
    double at = s->t - delay;
    long low = 0, high = s->kept;
    if (!s->kept || at < s->then[0] - 1e-9) return s->kept ? s->was[0] : now;
    while (high - low > 1) {
        long middle = (low + high) / 2;
        if (s->then[middle] <= at + 1e-9) low = middle; else high = middle;
    }
    if (held || low + 1 >= s->kept) return s->was[low];
    double share = (at - s->then[low]) / (s->then[low + 1] - s->then[low]);
    return s->was[low] + share * (s->was[low + 1] - s->was[low]);
}

static void remember(Slave *s, double value)
{
    if (s->kept < HISTORY) { s->then[s->kept] = s->t; s->was[s->kept++] = value; }
}

static double clip(double v, double low, double high) { return v < low ? low : v > high ? high : v; }
static double sign(double v) { return (v > 0) - (v < 0); }

typedef void Rates(const Slave *, const double *x, double *rates);

static void rk4(Slave *s, double h, int count, Rates *f)
{
    double a[8], b[8], c[8], d[8], y[8];
    int k;
    f(s, s->x, a);
    for (k = 0; k < count; k++) y[k] = s->x[k] + 0.5 * h * a[k];
    f(s, y, b);
    for (k = 0; k < count; k++) y[k] = s->x[k] + 0.5 * h * b[k];
    f(s, y, c);
    for (k = 0; k < count; k++) y[k] = s->x[k] + h * c[k];
    f(s, y, d);
    for (k = 0; k < count; k++) s->x[k] += h / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]);
}

/* ---- models ---- */

/* lag: gain 16, time constant 17 */
static void lag_start(Slave *s)
{
    s->r[16] = 2.0; s->r[17] = 0.1;
    if (is(s, "initial")) s->x[0] = 0.3;
    if (is(s, "initial_small")) s->x[0] = 0.02;
}
static void lag_rates(const Slave *s, const double *x, double *f)
{
    double tau = s->r[17];
    if (is(s, "tau5")) tau *= 1.05;
    if (is(s, "tau2")) tau *= 1.02;
    f[0] = (s->r[16] * s->r[0] - x[0]) / tau;
}
static void lag_advance(Slave *s, double h) { rk4(s, h, 1, lag_rates); }
static void first_state(Slave *s) { s->r[8] = s->x[0]; }

/* lag_euler: the same by Euler's method */
static void lag_euler_advance(Slave *s, double h)
{
    double f[8];
    lag_rates(s, s->x, f);
    s->x[0] += h * f[0];
}

/* oscillator: frequency 16 [rad/s], damping 17; outputs position and speed */
static void oscillator_start(Slave *s) { s->r[16] = 20.0; s->r[17] = 0.2; }
static void oscillator_rates(const Slave *s, const double *x, double *f)
{
    double w = s->r[16], d = s->r[17];
    if (is(s, "damping")) d *= 0.9;
    if (is(s, "frequency")) w *= 1.01;
    f[0] = x[1];
    f[1] = w * w * (s->r[0] - x[0]) - 2.0 * d * w * x[1];
}
static void oscillator_advance(Slave *s, double h) { rk4(s, h, 2, oscillator_rates); }
static void two_states(Slave *s) { s->r[8] = s->x[0]; s->r[9] = s->x[1]; }
static void symplectic_advance(Slave *s, double h)
{
    double f[8];
    oscillator_rates(s, s->x, f);
    s->x[1] += h * f[1];
    s->x[0] += h * s->x[1];
}

/* pid: plant 1/(0.2 s + 1), limits 16, 17; outputs y and u; states y, integral */
static void pid_start(Slave *s) { s->r[16] = -1.5; s->r[17] = 1.5; }
static double pid_wish(const Slave *s, const double *x)
{
    return 4.0 * (s->r[0] - x[0]) + x[1];
}
static void pid_rates(const Slave *s, const double *x, double *f)
{
    double wish = pid_wish(s, x), top = is(s, "limit") ? 1.4 : s->r[17];
    double u = clip(wish, s->r[16], top);
    f[0] = (u - x[0]) / 0.2;
    f[1] = 10.0 * (s->r[0] - x[0]) + (is(s, "windup") ? 0.0 : 5.0 * (u - wish));
}
static void pid_advance(Slave *s, double h) { rk4(s, h, 2, pid_rates); }
static void pid_outputs(Slave *s)
{
    s->r[8] = s->x[0];
    s->r[9] = clip(pid_wish(s, s->x), s->r[16], is(s, "limit") ? 1.4 : s->r[17]);
}

/* counter: of periods 16; integers */
static void counter_start(Slave *s) { s->r[16] = 0.1; }
static void nothing(Slave *s, double h) { (void)s; (void)h; }
static void counter_outputs(Slave *s)
{
    double period = is(s, "period") ? 1.05 * s->r[16] : s->r[16];
    int n = (int)floor(s->t / period + 1e-6);
    if (is(s, "missed") && n >= 4) n -= 1;
    if (is(s, "twice") && n >= 4) n += 1;
    if (is(s, "extra") && s->t > 0.345) n += 1;
    if (is(s, "overflow")) n %= 8;
    if (is(s, "late") && s->t < n * period + 0.02) n -= n > 0;
    if (is(s, "calls")) n = (int)(s->steps / 10);
    s->n[8] = n;
}

/* relay: hysteresis of 0.5 on input 0; Boolean */
static void relay_outputs(Slave *s)
{
    double band = is(s, "band") ? 0.6 : 0.5;
    if (s->r[0] > band) s->x[0] = 1.0;
    if (s->r[0] < -band) s->x[0] = 0.0;
    s->b[8] = s->x[0] > 0.5;
    if (is(s, "missed") && s->t > 0.5 && s->t < 0.9) s->b[8] = 0;
    if (is(s, "glitch") && s->t > 0.3145 && s->t < 0.3185) s->b[8] = !s->b[8];
    if (is(s, "inverted")) s->b[8] = !s->b[8];
}
static void relay_advance(Slave *s, double h) { (void)h; relay_outputs(s); }

/* ball: falls from 1 m, restitution 0.8, flights by their exact solution */
static void ball_start(Slave *s) { s->x[0] = 1.0; }
static void ball_advance(Slave *s, double h)
{
    double g = 9.81, e = is(s, "restitution") ? 0.79 : 0.8;
    while (h > 0.0) {
        double hit = (s->x[1] + sqrt(s->x[1] * s->x[1] + 2.0 * g * s->x[0])) / g;
        double d = hit < h ? hit : h;
        s->x[0] += s->x[1] * d - 0.5 * g * d * d;
        s->x[1] -= g * d;
        if (hit <= h) {
            s->x[0] = 0.0;
            if (!(is(s, "missed") && s->t > 1.0)) s->x[1] *= -e; else s->x[1] = 0.0;
        }
        h -= d;
        if (d <= 1e-12) break;
    }
}

/* vanderpol: mu 16 */
static void vanderpol_start(Slave *s) { s->r[16] = 1.0; s->x[0] = is(s, "initial") ? 2.05 : 2.0; }
static void vanderpol_rates(const Slave *s, const double *x, double *f)
{
    double mu = is(s, "mu") ? 1.05 : s->r[16];
    f[0] = x[1];
    f[1] = mu * (1.0 - x[0] * x[0]) * x[1] - x[0];
}
static void vanderpol_advance(Slave *s, double h) { rk4(s, h, 2, vanderpol_rates); }

/* sampled: a proportional-integral controller every 20 ms on an integrating plant with drag */
static void sampled_start(Slave *s) { s->n[20] = -1; }
static void sampled_outputs(Slave *s)
{
    double period = is(s, "period") ? 0.021 : 0.02;
    int k = (int)floor(s->t / period + 1e-6);
    if (k > s->n[20]) {
        double e = s->r[0] - (is(s, "held") ? s->x[3] : s->x[0]);
        s->n[20] = k;
        s->x[2] += 0.2 * e;
        s->x[3] = s->x[0];
        if (!(is(s, "missed") && k == 7)) s->r[9] = 6.0 * e + s->x[2];
    }
    s->r[8] = s->x[0];
}
static void sampled_rates(const Slave *s, const double *x, double *f)
{
    f[0] = s->r[9] - 2.0 * x[0];
}
static void sampled_advance(Slave *s, double h) { rk4(s, h, 1, sampled_rates); }

/* line: the input 50 ms ago */
static void line_advance(Slave *s, double h)
{
    if (!s->kept || s->then[s->kept - 1] < s->t - 1e-9) remember(s, s->r[0]);
    (void)h;
}
static void line_outputs(Slave *s)
{
    double delay = is(s, "calls") ? 50.0 * s->step : is(s, "longer") ? 0.055 : 0.05;
    s->r[8] = s->t < delay - 1e-9 ? 0.0 : ago(s, delay, 0.0, 1);
}

/* texts: a lag whose time constant is in a text */
static void texts_start(Slave *s) { strcpy(s->text, "slow"); }
static void texts_rates(const Slave *s, const double *x, double *f)
{
    double tau = strcmp(s->text, "fast") == 0 && !is(s, "deaf") ? 0.05 : 0.2;
    f[0] = (s->r[0] - x[0]) / tau;
}
static void texts_advance(Slave *s, double h) { rk4(s, h, 1, texts_rates); }

/* gears: integer input is the gear; integrates speed, states as an enumeration */
static void gears_advance(Slave *s, double h) { s->x[0] += h * (s->n[0] * 0.5); }
static void gears_outputs(Slave *s)
{
    s->r[8] = s->x[0];
    s->n[8] = s->x[0] < 0.2 ? 1 : s->x[0] < 0.6 ? 2 : 3;
    if (is(s, "states") && s->n[8] == 2) s->n[8] = 3;
}

/* rate: follows the input by at most 2 per second */
static void rate_advance(Slave *s, double h)
{
    double most = (is(s, "slower") ? 1.9 : 2.0) * h;
    s->x[0] += clip(s->r[0] - s->x[0], -most, most);
}

/* motor: speed [rad/s] and angle [rad] of a motor, and current [A] */
static void motor_rates(const Slave *s, const double *x, double *f)
{
    f[0] = x[1];
    f[1] = 50.0 * x[2] - 0.5 * x[1];
    f[2] = (s->r[0] - 0.05 * x[1] - 2.0 * x[2]) / 0.01;
}
static void motor_advance(Slave *s, double h) { rk4(s, h, 3, motor_rates); }
static void motor_outputs(Slave *s)
{
    s->r[8] = s->x[0]; s->r[9] = s->x[1]; s->r[10] = s->x[2];
    if (is(s, "current")) s->r[10] = -s->r[10];
}

/* heat: 300 K and a little more */
static void heat_start(Slave *s) { s->x[0] = 300.0; }
static void heat_rates(const Slave *s, const double *x, double *f)
{
    f[0] = (s->r[0] - 0.5 * (x[0] - 300.0)) / 10.0;
}
static void heat_advance(Slave *s, double h) { rk4(s, h, 1, heat_rates); }
static void heat_outputs(Slave *s)
{
    s->r[8] = s->x[0];
    if (is(s, "celsius")) s->r[8] -= 273.15;
}

/* play: a gap of 0.2 */
static void play_outputs(Slave *s)
{
    double half = is(s, "narrow") ? 0.09 : 0.1;
    s->x[0] = clip(s->x[0], s->r[0] - half, s->r[0] + half);
    s->r[8] = s->x[0];
}

/* stairs: the input in stairs of 0.25, a continuous output that jumps */
static void stairs_outputs(Slave *s)
{
    double step = 0.25, at = s->r[0] + (is(s, "shifted") ? 0.02 : 0.0);
    s->r[8] = step * floor(at / step + 0.5);
    if (is(s, "missed") && s->r[8] > 0.6 && s->r[8] < 0.9) s->r[8] = 0.5;
}

/* pulses: on for a share of 16 of every 50 ms */
static void pulses_start(Slave *s) { s->r[16] = 0.3; }
static void pulses_outputs(Slave *s)
{
    double at = fmod(s->t + 1e-7, 0.05), on = (is(s, "duty") ? 0.4 : s->r[16]) * 0.05;
    s->b[8] = at < on;
    if (is(s, "missed") && s->t > 0.44 && s->t < 0.49) s->b[8] = 0;
}

/* friction: a mass that slips from 0.5 N on; speed and whether it slips */
static void friction_advance(Slave *s, double h)
{
    double force = s->r[0], most = is(s, "less") ? 0.45 : 0.5;
    if (s->x[0] == 0.0 && fabs(force) <= most) return;
    double before = s->x[0] != 0.0 ? sign(s->x[0]) : sign(force);
    s->x[0] += h * (force - most * before);
    if (s->x[0] * before < 0.0) s->x[0] = 0.0;
}
static void friction_outputs(Slave *s) { s->r[8] = s->x[0]; s->b[8] = s->x[0] != 0.0; }

/* constant: nothing moves */
static void constant_outputs(Slave *s) { s->r[8] = is(s, "other") ? 4.19 : 4.2; }

/* servo: a geared motor that a gain 16 holds at its goal; resistance 17, torque constant 18 and
   inertia 19; states angle, speed and current */
static void servo_start(Slave *s)
{
    s->r[16] = 20.0; s->r[17] = 2.0; s->r[18] = 0.4; s->r[19] = 4e-3;
}
static void servo_rates(const Slave *s, const double *x, double *f)
{
    double voltage = s->r[16] * (s->r[0] - x[0]);
    f[0] = x[1];
    f[1] = (s->r[18] * x[2] - 0.04 * x[1]) / s->r[19];
    f[2] = (voltage - s->r[17] * x[2] - s->r[18] * x[1]) / 4e-3;
}
static void servo_advance(Slave *s, double h) { rk4(s, h, 3, servo_rates); }

/* limited: frequency 16, damping 17 and largest speed 18 of a servo; states angle and speed */
static void limited_start(Slave *s) { s->r[16] = 30.0; s->r[17] = 0.8; s->r[18] = 4.0; }
static void limited_advance(Slave *s, double h)
{
    double w = s->r[16];
    double push = w * w * (s->r[0] - s->x[0]) - 2.0 * s->r[17] * w * s->x[1];
    s->x[1] = clip(s->x[1] + h * push, -s->r[18], s->r[18]);
    s->x[0] += h * s->x[1];
}

static void none(Slave *s) { (void)s; }

static const Model MODELS[] = {
    {"lag", 1e-3, lag_start, lag_advance, first_state},
    {"lag_euler", 2e-5, lag_start, lag_euler_advance, first_state},
    {"oscillator", 1e-3, oscillator_start, oscillator_advance, two_states},
    {"symplectic", 2e-6, oscillator_start, symplectic_advance, two_states},
    {"pid", 2e-4, pid_start, pid_advance, pid_outputs},
    {"counter", 1.0, counter_start, nothing, counter_outputs},
    {"relay", 1.0, none, relay_advance, relay_outputs},
    {"ball", 1.0, ball_start, ball_advance, two_states},
    {"vanderpol", 1e-3, vanderpol_start, vanderpol_advance, two_states},
    {"sampled", 1e-3, sampled_start, sampled_advance, sampled_outputs},
    {"line", 1.0, none, line_advance, line_outputs},
    {"texts", 1e-3, texts_start, texts_advance, first_state},
    {"gears", 1e-3, none, gears_advance, gears_outputs},
    {"rate", 1e-4, none, rate_advance, first_state},
    {"motor", 5e-4, none, motor_advance, motor_outputs},
    {"heat", 1e-2, heat_start, heat_advance, heat_outputs},
    {"play", 1.0, none, nothing, play_outputs},
    {"stairs", 1.0, none, nothing, stairs_outputs},
    {"pulses", 1.0, pulses_start, nothing, pulses_outputs},
    {"friction", 1e-4, none, friction_advance, friction_outputs},
    {"constant", 1.0, none, nothing, constant_outputs},
    {"servo", 1e-3, servo_start, servo_advance, first_state},
    {"limited", 5e-4, limited_start, limited_advance, first_state},
};

/* ---- faults of any model's first output ---- */

static double noise(Slave *s)
{
    double sum = 0.0;
    for (int k = 0; k < 12; k++) {
        s->random = s->random * 1664525u + 1013904223u;
        sum += s->random / 4294967296.0;
    }
    return sum - 6.0;
}

static void spoil(Slave *s)
{
    double y = s->r[8], part = s->t;
    if (is(s, "gain")) y *= 1.01;
    if (is(s, "gain_small")) y *= 0.995;
    if (is(s, "gain_large")) y *= 1.5;
    if (is(s, "sign")) y = -y;
    if (is(s, "degrees")) y *= 180.0 / PI;
    if (is(s, "milli")) y *= 1000.0;
    if (is(s, "offset")) y += 0.01;
    if (is(s, "drift")) y += 0.02 * part;
    if (is(s, "drift_small")) y += 0.006 * part;
    if (is(s, "noise")) y += 0.01 * noise(s);
    if (is(s, "noise_small")) y += 0.002 * noise(s);
    if (is(s, "spike") && s->t > 0.4995 && s->t < 0.5005) y += 0.1;
    if (is(s, "stuck") && s->t > 0.15) y = s->x[7];
    if (is(s, "clipped")) y = clip(y, -0.97, 0.97);
    if (is(s, "coarse")) y = 0.02 * floor(y / 0.02 + 0.5);
    if (is(s, "nan") && s->t > 0.7) y = NAN;
    if (is(s, "swapped")) { y = s->r[9]; s->r[9] = s->r[8]; }
    if (is(s, "per_step")) y *= 1.0 + 4.0 * s->step;
    if (is(s, "delay5")) y = ago(s, 0.005, y, 0);
    if (is(s, "early5")) y = y + 0.005 * (y - s->x[6]) / (s->step > 0.0 ? s->step : 1.0);
    if (is(s, "delay1")) y = ago(s, s->step, y, 0);
    if (is(s, "delay20")) y = ago(s, 0.02, y, 0);
    s->r[8] = y;
}

static void outputs(Slave *s)
{
    s->model->outputs(s);
    double clean = s->r[8];
    if (s->model->advance != line_advance && strstr(s->fault, "delay")) remember(s, clean);
    spoil(s);
    s->x[6] = clean;
    if (!is(s, "stuck") || s->t <= 0.15) s->x[7] = s->r[8];
}

static int step(Slave *s, double h)
{
    double inner = s->model->inner;
    if (is(s, "one_step")) inner = 1.0;
    if (is(s, "refuses") && s->t > 0.5) return 0;
    int count = (int)ceil(h / inner - 1e-9);
    for (int k = 0; k < count; k++) s->model->advance(s, h / count);
    s->t += h;
    s->step = h;
    s->steps += 1;
    outputs(s);
    return 1;
}

static Slave *make(const char *guid)
{
    Slave *s = calloc(1, sizeof *s);
    char name[64];
    size_t end = strcspn(guid + 1, "/}");
    snprintf(name, sizeof name, "%.*s", (int)end, guid + 1);
    if (guid[1 + end] == '/')
        snprintf(s->fault, sizeof s->fault, "%.*s", (int)strcspn(guid + 2 + end, "}"),
                 guid + 2 + end);
    for (size_t k = 0; k < sizeof MODELS / sizeof *MODELS; k++)
        if (strcmp(MODELS[k].name, name) == 0) s->model = &MODELS[k];
    if (!s->model) { free(s); return NULL; }
    s->random = 1u;
    s->then = calloc(HISTORY, sizeof(double));
    s->was = calloc(HISTORY, sizeof(double));
    s->model->start(s);
    return s;
}

static void drop(Slave *s) { free(s->then); free(s->was); free(s); }

/* ---- FMI ---- */

#define COPY(count, place, value) for (size_t k = 0; k < (count); k++) { place = value; }

#ifdef FMI3

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path,
    fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)name; (void)path; (void)visible; (void)logging; (void)events; (void)early;
    (void)required; (void)count; (void)environment; (void)log; (void)update;
    return make(token);
}
void fmi3FreeInstance(fmi3Instance i) { drop(i); }
const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String names[])
{
    (void)i; (void)on; (void)n; (void)names;
    return fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean given, fmi3Float64 tolerance,
    fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
    (void)given; (void)tolerance; (void)ends; (void)stop;
    ((Slave *)i)->t = start;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance i) { outputs(i); return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance i) { (void)i; return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance i) { (void)i; return fmi3Error; }
fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_way_back,
    fmi3Boolean *event, fmi3Boolean *ends, fmi3Boolean *early, fmi3Float64 *last)
{
    (void)t; (void)no_way_back;
    *event = *ends = *early = false;
    fmi3Status status = step(i, h) ? fmi3OK : fmi3Error;
    *last = ((Slave *)i)->t;
    return status;
}
#define ACCESS(Name, type, place) \
    fmi3Status fmi3Get##Name(fmi3Instance i, const fmi3ValueReference vr[], size_t n, type v[], \
        size_t m) \
    { Slave *s = i; (void)m; COPY(n, v[k], (type)place) return fmi3OK; } \
    fmi3Status fmi3Set##Name(fmi3Instance i, const fmi3ValueReference vr[], size_t n, \
        const type v[], size_t m) \
    { Slave *s = i; (void)m; COPY(n, place, v[k]) return fmi3OK; }
ACCESS(Float64, fmi3Float64, s->r[vr[k]])
ACCESS(Float32, fmi3Float32, s->r[vr[k]])
ACCESS(Int32, fmi3Int32, s->n[vr[k] - 100])
ACCESS(Int64, fmi3Int64, s->n[vr[k] - 100])
ACCESS(UInt16, fmi3UInt16, s->n[vr[k] - 100])
ACCESS(Boolean, fmi3Boolean, s->b[vr[k] - 200])
fmi3Status fmi3SetString(fmi3Instance i, const fmi3ValueReference vr[], size_t n,
    const fmi3String v[], size_t m)
{
    (void)vr; (void)m;
    COPY(n, ((Slave *)i)->text[63], 0 * snprintf(((Slave *)i)->text, 63, "%s", v[k]))
    return fmi3OK;
}

#else

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String where,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name; (void)type; (void)where; (void)functions; (void)visible; (void)logging;
    return make(guid);
}
void fmi2FreeInstance(fmi2Component c) { drop(c); }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
{
    (void)c; (void)on; (void)n; (void)names;
    return fmi2OK;
}
const char *fmi2GetTypesPlatform(void) { return "default"; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance,
    fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
    (void)given; (void)tolerance; (void)ends; (void)stop;
    ((Slave *)c)->t = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { outputs(c); return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { (void)c; return fmi2Error; }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_way_back)
{
    (void)t; (void)no_way_back;
    return step(c, h) ? fmi2OK : fmi2Discard;
}
#define ACCESS(Name, type, place) \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type v[]) \
    { Slave *s = c; COPY(n, v[k], (type)place) return fmi2OK; } \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference vr[], size_t n, \
        const type v[]) \
    { Slave *s = c; COPY(n, place, v[k]) return fmi2OK; }
ACCESS(Real, fmi2Real, s->r[vr[k]])
ACCESS(Integer, fmi2Integer, s->n[vr[k] - 100])
ACCESS(Boolean, fmi2Boolean, s->b[vr[k] - 200])
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
    const fmi2String v[])
{
    (void)vr;
    COPY(n, ((Slave *)c)->text[63], 0 * snprintf(((Slave *)c)->text, 63, "%s", v[k]))
    return fmi2OK;
}

#endif
