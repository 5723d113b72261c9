/* Part of fmi_calls.c: the FMU, what its instances are to answer, and the judgement of a call. */
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>

#include "fmi2_library.h"

enum {
    INSTANCES = 4,   /* alive at once */
    STATES = 6,      /* saved at once */
    VARIABLES = 200, /* of an FMU, at most */
    OUTPUTS = 40     /* of them */
};

/* ---- the FMU ---------------------------------------------------------------------------- */

enum kind { INPUT, OUTPUT, FLAG, PARAMETER, FIXED };
static const char *const kinds[] = {"input", "output", "flag", "parameter", "fixed"};

struct variable {
    enum kind kind;
    fmi2ValueReference reference;
    double low, high, start, nominal;
};

/* Written once, before the first sequence. */
static struct {
    fmi2_library call;
    char guid[256];
    int has_derivatives;
    struct variable variables[VARIABLES];
    int count;
    int outputs[OUTPUTS]; /* indices of real outputs */
    int output_count;
    int internal_step; /* index, or -1 */
    fmi2ValueReference unknown; /* the first value reference that is none */
    int threads;
    int traces; /* print every call */
} fmu;

static void read_variables(const char *path)
{
    FILE *file = fopen(path, "r");
    char kind[16], name[256];
    struct variable v;
    if (!file || fscanf(file, "%255s %d", fmu.guid, &fmu.has_derivatives) != 2) {
        fprintf(stderr, "cannot read '%s'\n", path);
        exit(2);
    }
    fmu.internal_step = -1;
    while (fscanf(file, "%15s %u %lf %lf %lf %lf %255s", kind, &v.reference, &v.low, &v.high,
                  &v.start, &v.nominal, name) == 7) {
        if (fmu.count == VARIABLES || fmu.output_count == OUTPUTS) {
            fprintf(stderr, "too many variables for this driver\n");
            exit(2);
        }
        for (v.kind = INPUT; strcmp(kind, kinds[v.kind]) != 0; v.kind++)
            ;
        if (v.kind == OUTPUT)
            fmu.outputs[fmu.output_count++] = fmu.count;
        if (strcmp(name, "internal_step") == 0)
            fmu.internal_step = fmu.count;
        if (v.reference >= fmu.unknown)
            fmu.unknown = v.reference + 1;
        fmu.variables[fmu.count++] = v;
    }
    fclose(file);
}

static int can_be_set(int index)
{
    return fmu.variables[index].kind != OUTPUT && fmu.variables[index].kind != FLAG;
}

/* The FMU is compiled with these in place of malloc and calloc: memory runs out on demand. */
static __thread int allocations_left = -1; /* negative: any number */

static int has_memory(void)
{
    const int has = allocations_left != 0;
    if (allocations_left > 0)
        allocations_left--;
    return has;
}

void *scarce_malloc(size_t size)
{
    return has_memory() ? malloc(size) : NULL;
}

void *scarce_calloc(size_t count, size_t size)
{
    return has_memory() ? calloc(count, size) : NULL;
}

/* ---- a sequence, and what its instances are to answer ------------------------------------ */

enum phase { INSTANTIATED, INITIALISING, RUNNING, TERMINATED };

struct expected {
    enum phase phase;
    int failed; /* everything is refused but a reset or a restored state */
    int wild;   /* values far from those at the start: a step may be refused */
    double begins, last, time;
    double values[VARIABLES]; /* of inputs and parameters */
};

struct instance {
    fmi2Component component; /* NULL: this place is free */
    struct expected expected;
    char name[32];
};

struct saved {
    fmi2FMUstate state; /* NULL: this place is free */
    struct expected expected;
    double outputs[OUTPUTS];
};

struct counts {
    uint64_t calls, refused, steps;
};

struct sequence {
    uint64_t seed, random, digest;
    struct counts counts;
    struct instance instances[INSTANCES];
    struct saved saved[STATES];
    int instantiated;
    int messages; /* since the present call began */
    off_t stderr_at;
};

static uint64_t random_bits(struct sequence *s) /* splitmix64 */
{
    uint64_t z = s->random += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return z ^ z >> 31;
}

static int below(struct sequence *s, int limit)
{
    return (int)(random_bits(s) % (uint64_t)limit);
}

static double between(struct sequence *s, double low, double high)
{
    return low + (high - low) * ((double)(random_bits(s) >> 11) * 0x1p-53);
}

static int chance(struct sequence *s, double share)
{
    return between(s, 0.0, 1.0) < share;
}

/* FNV-1a over all that the FMU answers. */
static void digest(struct sequence *s, const void *bytes, size_t count)
{
    const unsigned char *byte = bytes;
    for (size_t i = 0; i < count; i++)
        s->digest = (s->digest ^ byte[i]) * UINT64_C(1099511628211);
}

static void fault(const struct sequence *s, const char *format, ...)
{
    static pthread_mutex_t one_at_a_time = PTHREAD_MUTEX_INITIALIZER;
    va_list values;
    pthread_mutex_lock(&one_at_a_time);
    printf("FAULT in sequence %" PRIu64 ": ", s->seed);
    va_start(values, format);
    vprintf(format, values);
    va_end(values);
    printf("\n");
    fflush(stdout);
    _exit(1);
}

/* ---- a call and its judgement ------------------------------------------------------------ */

/* The message has to be a printf format that needs exactly its arguments. */
static void logger(void *environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String format, ...)
{
    struct sequence *s = environment;
    char text[2048];
    va_list values;
    va_start(values, format);
    vsnprintf(text, sizeof text, format, values);
    va_end(values);
    digest(s, text, strlen(text));
    int is_ours = name && strcmp(name, "?") == 0;
    for (int i = 0; i < INSTANCES; i++)
        is_ours = is_ours || (name && strcmp(name, s->instances[i].name) == 0);
    if (!is_ours || !category)
        fault(s, "a message without the name of its instance or without a category: %s", text);
    if (status < fmi2OK || status > fmi2Fatal)
        fault(s, "a message of status %d: %s", status, text);
    s->messages += *text != '\0';
    if (fmu.traces)
        printf("        %s\n", text);
}

static off_t length_of_stderr(void)
{
    return lseek(STDERR_FILENO, 0, SEEK_CUR);
}

/* Note a call that is about to be made. */
static void calling(struct sequence *s, const char *format, ...)
{
    if (fmu.traces) {
        va_list values;
        va_start(values, format);
        vprintf(format, values);
        va_end(values);
        printf("\n");
        fflush(stdout); /* the call may be the last one */
    }
    s->counts.calls++;
    s->messages = 0;
    s->stderr_at = length_of_stderr();
}

static void need_message(struct sequence *s)
{
    if (!s->messages && !fmu.threads && length_of_stderr() == s->stderr_at)
        fault(s, "refused without a message");
}

/* Whether a call was refused, with a message. */
static int is_refused(struct sequence *s, fmi2Status status)
{
    digest(s, &status, sizeof status);
    if (fmu.traces && status != fmi2OK)
        printf("    -> %d\n", status);
    if (status == fmi2OK || status == fmi2Warning)
        return 0;
    if (status != fmi2Discard && status != fmi2Error && status != fmi2Fatal)
        fault(s, "status %d", status);
    need_message(s);
    s->counts.refused++;
    return 1;
}

enum outcome {
    SUCCEEDS,
    FAILS,   /* is refused, and the instance has failed */
    REFUSED, /* is refused; the instance may have failed */
    MAY_FAIL /* the standard or the model leave it open */
};

/* See whether an instance still answers, after a call that left it open. */
static void probe(struct sequence *s, struct instance *i)
{
    double value;
    calling(s, "%s: probed by fmi2GetReal", i->name);
    const int refused = is_refused(
        s, fmu.call.GetReal(i->component, &fmu.variables[fmu.outputs[0]].reference, 1, &value));
    if (i->expected.failed && !refused)
        fault(s, "an instance that has failed answers");
    i->expected.failed = refused;
}

/* Compare the outcome of a call with what is expected: whether the call succeeded. */
static int succeeded(struct sequence *s, struct instance *i, fmi2Status status,
                     enum outcome outcome)
{
    const int refused = is_refused(s, status);
    if (i->expected.failed)
        outcome = FAILS;
    if (refused && outcome == SUCCEEDS)
        fault(s, "a legal call is refused");
    if (!refused && (outcome == FAILS || outcome == REFUSED))
        fault(s, "succeeds, but is to be refused");
    if (outcome == FAILS)
        i->expected.failed = 1;
    else if (refused)
        probe(s, i);
    return !refused;
}

/* The same for a call that an instance may allow after a failure: it stays failed. */
static int allowed_after_failure(struct sequence *s, struct instance *i, fmi2Status status,
                                 enum outcome outcome)
{
    if (!i->expected.failed)
        return succeeded(s, i, status, outcome);
    const int refused = is_refused(s, status);
    probe(s, i);
    return !refused;
}
