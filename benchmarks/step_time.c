/* Time of a step of an FMU's library, as a C host takes it: set the inputs, step, get the outputs.
 *
 * step_time LIBRARY GUID INSTANCES STEPS REPEATS SIZE LOW HIGH INPUTS OUTPUTS
 *
 * INPUTS and OUTPUTS are value references with commas between, all Real.  The first input jumps
 * between LOW and HIGH every 64 steps, the others stay as they are.  All instances are stepped in
 * turn.  Prints nanoseconds a step (the best repeat), kB an instance after the first repeat, kB of
 * growth from then to the last, and the sum of all outputs of the last repeat. */

#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"

enum { MOST = 64 };

static fmi2InstantiateTYPE *instantiate;
static fmi2SetupExperimentTYPE *setup;
static fmi2EnterInitializationModeTYPE *enter;
static fmi2ExitInitializationModeTYPE *leave;
static fmi2SetRealTYPE *set_real;
static fmi2GetRealTYPE *get_real;
static fmi2DoStepTYPE *do_step;
static fmi2TerminateTYPE *terminate;
static fmi2FreeInstanceTYPE *free_instance;

static void check(int right, const char *what)
{
    if (!right) {
        fprintf(stderr, "step_time: %s fails\n", what);
        exit(1);
    }
}

static void bind(void *library, const char *name, void *function)
{
    void *found = dlsym(library, name);
    check(found != NULL, name);
    memcpy(function, &found, sizeof found); /* ISO C has no cast from an object to a function */
}

static void load(const char *path)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    check(library != NULL, path);
    bind(library, "fmi2Instantiate", &instantiate);
    bind(library, "fmi2SetupExperiment", &setup);
    bind(library, "fmi2EnterInitializationMode", &enter);
    bind(library, "fmi2ExitInitializationMode", &leave);
    bind(library, "fmi2SetReal", &set_real);
    bind(library, "fmi2GetReal", &get_real);
    bind(library, "fmi2DoStep", &do_step);
    bind(library, "fmi2Terminate", &terminate);
    bind(library, "fmi2FreeInstance", &free_instance);
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
    fmi2String category, fmi2String message, ...)
{
    va_list rest;
    va_start(rest, message);
    vfprintf(stderr, message, rest);
    va_end(rest);
    fputc('\n', stderr);
}

static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};

static fmi2Component initialised(const char *guid)
{
    fmi2Component c = instantiate("bench", fmi2CoSimulation, guid, "", &callbacks, 0, 0);
    check(c != NULL, "fmi2Instantiate");
    check(setup(c, 0, 0.0, 0.0, 0, 0.0) == fmi2OK, "fmi2SetupExperiment");
    check(enter(c) == fmi2OK, "fmi2EnterInitializationMode");
    check(leave(c) == fmi2OK, "fmi2ExitInitializationMode");
    return c;
}

static size_t references(char *list, fmi2ValueReference *reference)
{
    size_t n = 0;
    for (char *item = strtok(list, ","); item; item = strtok(NULL, ",")) {
        check(n < MOST, "too many variables: step_time");
        reference[n++] = (fmi2ValueReference)atoi(item);
    }
    return n;
}

static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static long resident_kb(void)
{
    long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    check(file != NULL && fscanf(file, "%*d %ld", &pages) == 1, "/proc/self/statm");
    fclose(file);
    return pages * (sysconf(_SC_PAGESIZE) / 1024);
}

int main(int argc, char **argv)
{
    check(argc == 11, "not ten arguments: step_time");
    int instances = atoi(argv[3]), steps = atoi(argv[4]), repeats = atoi(argv[5]);
    double size = atof(argv[6]), low = atof(argv[7]), high = atof(argv[8]);
    fmi2ValueReference input[MOST], output[MOST];
    size_t inputs = references(argv[9], input), outputs = references(argv[10], output);
    double in[MOST], out[MOST], best = 1e9, sum = 0.0;

    load(argv[1]);
    fmi2Component *c = calloc((size_t)instances, sizeof *c);
    check(c != NULL, "memory");
    long before = resident_kb(), first = 0;
    for (int i = 0; i < instances; ++i)
        c[i] = initialised(argv[2]);
    check(get_real(c[0], input, inputs, in) == fmi2OK, "fmi2GetReal of the inputs");

    for (int repeat = 0, step = 0; repeat < repeats; ++repeat) {
        double begin = seconds();
        sum = 0.0;
        for (int end = step + steps; step < end; ++step) {
            in[0] = step / 64 % 2 ? low : high;
            for (int i = 0; i < instances; ++i) {
                check(set_real(c[i], input, inputs, in) == fmi2OK
                    && do_step(c[i], step * size, size, fmi2True) == fmi2OK
                    && get_real(c[i], output, outputs, out) == fmi2OK, "a step");
                for (size_t k = 0; k < outputs; ++k)
                    sum += out[k];
            }
        }
        double took = (seconds() - begin) / steps / instances;
        best = took < best ? took : best;
        first = repeat ? first : resident_kb();
    }
    printf("%.1f %.1f %ld %.17g\n", 1e9 * best, (double)(first - before) / instances,
        resident_kb() - first, sum);
    for (int i = 0; i < instances; ++i) {
        check(terminate(c[i]) == fmi2OK, "fmi2Terminate");
        free_instance(c[i]);
    }
    return 0;
}
