/* Arithmetic as Python does it: the same bits, and "failed" where Python raises. */
#ifndef ARITHMETIC_H
#define ARITHMETIC_H

/* A product and a sum that a compiler contracts into one operation round once, not twice. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

#if defined(__FAST_MATH__) || defined(_M_FP_FAST) \
    || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compile without -ffast-math, -ffinite-math-only or /fp:fast: NaN would not be seen"
#endif

#include <math.h>

/* Flags and counters. */
typedef long long Whole;

static inline double divided(double a, double b, int *failed)
{
    *failed |= b == 0.0;
    return a / b;
}

/* "a % b" of whole numbers, which takes the sign of b in Python. */
static inline double remainder_of(double a, double b, int *failed)
{
    double rest;
    *failed |= b == 0.0;
    rest = fmod(a, b);
    return rest != 0.0 && (rest < 0.0) != (b < 0.0) ? rest + b : rest + 0.0; /* no -0 */
}

/* A result that is no number although the argument is one, and an infinite one of a finite one. */
#define CHECKED(name)                                                       \
    static inline double checked_##name(double x, int *failed)             \
    {                                                                       \
        const double y = name(x);                                           \
        *failed |= (y != y && x == x) || (fabs(y) > MOST && fabs(x) <= MOST); \
        return y;                                                           \
    }
#define MOST 1.7976931348623157e308

CHECKED(acos)
CHECKED(asin)
CHECKED(cos)
CHECKED(cosh)
CHECKED(exp)
CHECKED(expm1)
CHECKED(log)
CHECKED(log10)
CHECKED(log1p)
CHECKED(sin)
CHECKED(sinh)
CHECKED(sqrt)
CHECKED(tan)

/* Whole numbers: Python has none for NaN and infinity, and C no index; nor has Python a -0. */
#define WHOLE(name)                                             \
    static inline double checked_##name(double x, int *failed) \
    {                                                           \
        const int good = fabs(x) <= MOST;                       \
        *failed |= !good;                                       \
        return good ? name(x) + 0.0 : 0.0;                      \
    }

WHOLE(ceil)
WHOLE(floor)
WHOLE(trunc)

#endif
