/* Instructions of a step: SysTick counts the clock of the processor; the emulator executes an
 * instruction in a nanosecond (`-icount shift=0`), and the clock has 25 MHz: 40 instructions. */
#include <stdint.h>
#include <stdio.h>

#include "KEY.h"
#include "data.h"

enum { PER_TICK = 40 };

static volatile uint32_t *const control = (volatile uint32_t *)0xE000E010u;
static volatile uint32_t *const reload = (volatile uint32_t *)0xE000E014u;
static volatile uint32_t *const value = (volatile uint32_t *)0xE000E018u;

static KEY_memory memory;
static KEY_workspace work;

int main(void)
{
    uint32_t most = 0;
    uint64_t total = 0;
    int k;
    RESULTS
    SETTINGS
    *reload = 0xFFFFFFu;
    *value = 0;
    *control = 5; /* on, clock of the processor */
    KEY_init(&memory);
    for (k = 0; k < SAMPLES; ++k) {
        const uint32_t before = *value;
        KEY_step(ARGUMENTS);
        const uint32_t took = (before - *value) & 0xFFFFFFu;
        most = took > most ? took : most;
        total += took;
    }
    printf("%lu %lu\n", (unsigned long)(total * PER_TICK / SAMPLES), (unsigned long)most * PER_TICK);
    return 0;
}
