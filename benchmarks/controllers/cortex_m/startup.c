/* Start of a program on a Cortex-M4F or M7 without operating system: stack, unit for floating point,
 * then the start of the C library, which takes input and output from the debugger (semihosting). */
#include <stdint.h>

extern uint32_t stack_top[]; /* of the linker script */
void _start(void);
void reset(void);
void stopped(void);

void reset(void)
{
    volatile uint32_t *const access = (volatile uint32_t *)0xE000ED88u; /* CPACR */
    *access |= 0xFu << 20; /* coprocessors 10 and 11: the unit for floating point */
    __asm volatile("dsb\n isb");
    _start();
}

/* A fault ends the program with an error: SYS_EXIT_EXTENDED of semihosting. */
void stopped(void)
{
    const uint32_t report[2] = {0x20023u, 1u}; /* ADP_Stopped_RunTimeErrorUnknown */
    register uint32_t call __asm("r0") = 0x20u;
    register const uint32_t *with __asm("r1") = report;
    __asm volatile("bkpt 0xab" : : "r"(call), "r"(with) : "memory");
    for (;;) {
    }
}

typedef void (*handler)(void);
__attribute__((section(".vectors"), used)) static const handler vectors[16] = {
    (handler)stack_top, reset,   stopped, stopped, stopped, stopped, stopped, stopped,
    stopped,            stopped, stopped, stopped, stopped, stopped, stopped, stopped
};
