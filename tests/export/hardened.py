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
        SETTINGS DEFAULTS
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

BAD = """
/* Inputs by trial, sample and place: a recording, and what is made to be bad. */
static double made(int trial, int k, int i)
{
    static unsigned long state = 7;
    double random;
    state = (state * 1103515245UL + 12345UL) & 0x7fffffffUL;
    random = (double)(state / 65536UL % 2001UL) / 1000.0 - 1.0;
    switch (trial) {
    case 0: return 0.3 * (k % 5) - 0.6;
    case 1: return 1e3 * random;
    case 2: return k % 11 == 5 + i ? NAN : 0.1 * random;
    case 3: return k % 13 == 7 ? INFINITY : (k % 2 ? 50.0 : -50.0);
    default: return 1e-3 * random;
    }
}
static double seen(int trial, int k, int i)
{
    return trial == 4 && (k + i) % 3 == 0 ? 0.0 : trial == 0 && k % 4 == 3 ? 0.0 : 1.0;
}
enum { TRIALS = 5 };
"""
"""Five trials."""

COUNTING = """
#include <math.h>
#include <cmath>
struct Counts { long plain, divisions, roots, functions; };
static Counts counts;
struct Counting {
    double value;
    Counting(double v = 0.0) : value(v) {}
    explicit operator int() const { return (int)value; }
};
#define PLAIN(op) \\
    static inline Counting operator op(Counting a, Counting b) \\
    { ++counts.plain; return a.value op b.value; } \\
    static inline Counting &operator op##=(Counting &a, Counting b) { return a = a op b; }
#define COMPARED(op) \\
    static inline bool operator op(Counting a, Counting b) \\
    { ++counts.plain; return a.value op b.value; }
PLAIN(+) PLAIN(-) PLAIN(*)
COMPARED(<) COMPARED(<=) COMPARED(>) COMPARED(>=) COMPARED(==) COMPARED(!=)
static inline Counting operator-(Counting a) { ++counts.plain; return -a.value; }
static inline Counting operator/(Counting a, Counting b)
{ ++counts.divisions; return a.value / b.value; }
static inline Counting &operator/=(Counting &a, Counting b) { return a = a / b; }
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

COUNTED = (
    """
#include <stdio.h>
#include "KEY.c"
#include "recorded.h"
"""
    + BAD
    + """
static void keep(long *most, long now) { if (now > *most) *most = now; }
int main()
{
    static KEY_memory memory;
    static KEY_workspace work;
    Counts most = {0, 0, 0, 0};
    KEY_real u[NU + 1], y[NY + 1], mask[NY + 1];
    OUTPUTS
    SETTINGS DEFAULTS
    for (int trial = 0; trial < TRIALS + 2; ++trial) {
        const bool real = trial >= TRIALS; /* the recording, and with the measurements shaken */
        KEY_init(&memory);
        for (int k = 0; k < (real ? RECORDED : 40); ++k) {
            for (int i = 0; i < NU; ++i)
                u[i] = real ? recorded_u[k][i]
                     : trial == 0 ? k % 7 - 3.0 : made(trial == 2 ? 4 : trial, k, i);
            for (int i = 0; i < NY; ++i) {
                y[i] = real ? recorded_y[k][i] : made(trial, k, i);
                if (trial > TRIALS)
                    y[i] = 10.0 * recorded_y[k * k % RECORDED][i] * made(1, k, i);
                mask[i] = real ? recorded_mask[k][i] : seen(trial, k, i);
            }
            counts = Counts();
            KEY_step(&memory, &work, ARGUMENTS);
            keep(&most.plain, counts.plain);
            keep(&most.divisions, counts.divisions);
            keep(&most.roots, counts.roots);
            keep(&most.functions, counts.functions);
        }
    }
    printf("%ld %ld %ld %ld", most.plain, most.divisions, most.roots, most.functions);
    return 0;
}
"""
)

STACK = (
    """
#define _XOPEN_SOURCE 600
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <ucontext.h>
#include "KEY.h"
"""
    + BAD
    + """
enum { ROOM = 1 << 20 };
static unsigned char area[ROOM];
static ucontext_t back, there;
static KEY_memory memory;
static KEY_workspace work;
static KEY_real u[NU + 1], y[NY + 1], mask[NY + 1];
OUTPUTS
SETTINGS

static void nothing(void) {}
static void step(void) { KEY_step(&memory, &work, ARGUMENTS); }

/* Bytes of a painted stack that a call has touched. */
static long depth(void (*call)(void))
{
    long free = 0;
    memset(area, 0xa5, sizeof area);
    getcontext(&there);
    there.uc_stack.ss_sp = area;
    there.uc_stack.ss_size = sizeof area;
    there.uc_link = &back;
    makecontext(&there, call, 0);
    swapcontext(&back, &there);
    while (free < ROOM && area[free] == 0xa5)
        ++free;
    return ROOM - free;
}

int main(void)
{
    long most = 0;
    int trial, k, i;
    DEFAULTS
    for (trial = 0; trial < TRIALS; ++trial) {
        KEY_init(&memory);
        for (k = 0; k < 8; ++k) {
            long now;
            for (i = 0; i < NU; ++i)
                u[i] = (KEY_real)made(trial == 2 ? 4 : trial, k, i);
            for (i = 0; i < NY; ++i) {
                y[i] = (KEY_real)made(trial, k, i);
                mask[i] = (KEY_real)seen(trial, k, i);
            }
            now = depth(step);
            most = now > most ? now : most;
        }
    }
    printf("%ld %lu %lu", most - depth(nothing), (unsigned long)sizeof memory,
           (unsigned long)sizeof work);
    return 0;
}
"""
)


def filled(template, key, code):
    """A program for an export."""
    recursion, settings = code.open.plain, bool(code.open.fields)
    static = "static " if template is STACK else ""
    outputs = list(zip(recursion.channels, recursion.output_sizes, strict=True))
    nu, ny, _ = recursion.input_sizes
    arguments = ["&settings"] * settings + ["u", "y", "mask"] + [c.name for c, _ in outputs]
    defaults = "KEY_defaults(&settings);" if settings else ""
    replaced = {
        "OUTPUTS": " ".join(f"{static}KEY_real {c.name}[{max(n, 1)}];" for c, n in outputs),
        "SETTINGS": f"{static}KEY_settings settings;" if settings else "",
        "DEFAULTS": defaults,
        "ARGUMENTS": ", ".join(arguments),
        "NU": str(nu),
        "NY": str(ny),
        "KEY": key,
    }
    for word, text in replaced.items():
        template = template.replace(word, text)
    return template


def recorded(data):
    """A recording as tables in C: u, y and mask, (n, m) each."""
    lines = [f"enum {{ RECORDED = {len(data[0])} }};"]
    for name, values in zip(("u", "y", "mask"), data, strict=True):
        width = max(values.shape[1], 1)
        rows = ", ".join("{" + ", ".join(map(repr, map(float, row))) + "}" for row in values)
        lines.append(f"static const double recorded_{name}[RECORDED][{width}] = {{{rows}}};")
    return "\n".join(lines) + "\n"
