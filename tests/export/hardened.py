"""Programs in C and C++ that ask much of exported code."""

FUZZ = """
#include <math.h>
#include <float.h>
#include "KEY.h"

static unsigned long state = 1;

static double number(void)
{
    static const double odd[10] = {
        0.0, -0.0, 4.9e-324, -1e-310, DBL_MAX, -1e200, INFINITY, -INFINITY, NAN, 1e-160
    };
    state = (state * 1103515245UL + 12345UL) & 0x7fffffffUL;
    if (state / 65536UL % 4UL == 0UL)
        return odd[state / 262144UL % 10UL];
    return (double)(state / 65536UL % 2001UL) / 1000.0 - 1.0;
}

int main(void)
{
    static KEY_memory memory;
    static KEY_workspace work;
    KEY_real u[NU + 1], y[NY + 1], mask[NY + 1];
    OUTPUTS
    int trial, k, i;
    for (trial = 0; trial < 40; ++trial) {
        SETTINGS
        KEY_init(&memory);
        for (k = 0; k < 12; ++k) {
            for (i = 0; i < NU; ++i)
                u[i] = (KEY_real)(k < 4 ? 0.1 : number());
            for (i = 0; i < NY; ++i) {
                y[i] = (KEY_real)(k < 4 ? 0.1 : number());
                mask[i] = (KEY_real)(k % 3 == 2 ? 0.0 : 1.0);
            }
            KEY_step(&memory, &work, ARGUMENTS);
        }
    }
    return 0;
}
"""

COUNTING = """
#include <math.h>
#include <cmath>
struct Counts { long plain, divisions, roots, functions; };
static Counts counts;
struct Counting {
    double value;
    Counting(double v = 0.0) : value(v) {}
};
#define PLAIN(op) \\
    static inline Counting operator op(Counting a, Counting b) \\
    { ++counts.plain; return a.value op b.value; }
#define COMPARED(op) \\
    static inline bool operator op(Counting a, Counting b) \\
    { ++counts.plain; return a.value op b.value; }
PLAIN(+) PLAIN(-) PLAIN(*)
COMPARED(<) COMPARED(<=) COMPARED(>) COMPARED(>=) COMPARED(==) COMPARED(!=)
static inline Counting operator-(Counting a) { ++counts.plain; return -a.value; }
static inline Counting operator/(Counting a, Counting b)
{ ++counts.divisions; return a.value / b.value; }
static inline Counting sqrt(Counting a) { ++counts.roots; return std::sqrt(a.value); }
#define SIMPLE(name) \\
    static inline Counting name(Counting a) { ++counts.plain; return std::name(a.value); }
#define FUNCTION(name) \\
    static inline Counting name(Counting a) { ++counts.functions; return std::name(a.value); }
#define SIMPLE_OF_TWO(name) \\
    static inline Counting name(Counting a, Counting b) \\
    { ++counts.plain; return std::name(a.value, b.value); }
SIMPLE(fabs) FUNCTION(floor) FUNCTION(exp) FUNCTION(log) FUNCTION(sin) FUNCTION(cos) FUNCTION(tanh)
FUNCTION(erf) FUNCTION(ceil) FUNCTION(tan) FUNCTION(atan) FUNCTION(sinh) FUNCTION(cosh)
SIMPLE_OF_TWO(fmin) SIMPLE_OF_TWO(fmax) SIMPLE_OF_TWO(copysign)
"""

COUNTED = """
#include <stdio.h>
#include "KEY.c"
int main()
{
    static KEY_memory memory;
    static KEY_workspace work;
    Counts most = {0, 0, 0, 0};
    KEY_real u[NU + 1], y[NY + 1], mask[NY + 1];
    OUTPUTS
    SETTINGS
    KEY_init(&memory);
    for (int k = 0; k < 60; ++k) {
        for (int i = 0; i < NU; ++i)
            u[i] = k % 7 - 3.0;
        for (int i = 0; i < NY; ++i) {
            y[i] = 0.3 * (k % 5) - 0.6;
            mask[i] = k % 4 == 3 ? 0.0 : 1.0;
        }
        counts = Counts();
        KEY_step(&memory, &work, ARGUMENTS);
        if (counts.plain > most.plain) most.plain = counts.plain;
        if (counts.divisions > most.divisions) most.divisions = counts.divisions;
        if (counts.roots > most.roots) most.roots = counts.roots;
        if (counts.functions > most.functions) most.functions = counts.functions;
    }
    printf("%ld %ld %ld %ld", most.plain, most.divisions, most.roots, most.functions);
    return 0;
}
"""


def filled(template, key, recursion, *, settings):
    """A program for an export; `recursion` is as the estimator makes it."""
    outputs = list(zip(recursion.channels, recursion.output_sizes, strict=True))
    nu, ny, _ = recursion.input_sizes
    arguments = ["&settings"] * settings + ["u", "y", "mask"] + [c.name for c, _ in outputs]
    replaced = {
        "OUTPUTS": " ".join(f"KEY_real {c.name}[{max(n, 1)}];" for c, n in outputs),
        "SETTINGS": "KEY_settings settings; KEY_defaults(&settings);" if settings else "",
        "ARGUMENTS": ", ".join(arguments),
        "NU": str(nu),
        "NY": str(ny),
        "KEY": key,
    }
    for word, text in replaced.items():
        template = template.replace(word, text)
    return template
