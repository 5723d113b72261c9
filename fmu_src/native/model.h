/* What a model.c gives to instance.c: constants, tables, and the text of the model.
 *
 *     enum { INPUTS, OUTPUTS, PARAMETERS, VARIABLES, STATES, KEPT, SIZE, EFFECTS, SWITCHES, NOTICES,
 *            CHECKED, TOO_FAST, ARITHMETIC };
 *     static const Variable variables[VARIABLES];    by value reference: inputs, outputs, parameters
 *     static const char *const states[];             names of the first STATES places of x
 *     static const int owners[KEPT];                 effect of the first KEPT places of x, or -1
 *     static const Switch switches[];                an effect is off while all of its are 0
 *     static const char *const faults[];             what code -1 - k of a step means
 *     static const Notice notices[];                 of what to warn where that place of x is not 0
 *     static const Checked checked[];                ranges of all inputs, or of none
 *     typedef struct {...} Setup;                    what depends on parameters only
 *     static int prepare(Setup *, const double *p);  0, or ARITHMETIC
 *     static void at_rest(const Setup *, double *x);
 *     static int step(const Setup *, double *x, const double *u, double t, double size, double *y);
 *
 * "step" returns 0, a fault, 1 + i for a state or an output that is not finite, TOO_FAST with the
 * internal step that would do in x[0], or ARITHMETIC.  A size of 0 only looks at the outputs.
 */
#ifndef MODEL_H
#define MODEL_H

typedef struct {
    const char *name;
    const char *unit;
    double start;
    double low;
    double high;
    double nominal;
    int fixed; /* cannot be set once a run has begun */
    int flag;  /* Boolean */
} Variable;

typedef struct {
    int effect;
    int parameter;
} Switch;

typedef struct {
    int place;
    const char *message;
} Notice;

typedef struct {
    double low;
    double high;
    const char *message; /* of an input outside */
} Checked;

#endif
