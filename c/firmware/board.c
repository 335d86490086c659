/* The least that a Cortex-M needs to run main and to speak over semihosting, as QEMU has it. */
#include "board.h"

#include <stdint.h>

extern uint32_t _stack, _data, _data_end, _data_from, _bss, _bss_end;
int main(void);
void reset(void);

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_NOW REGISTER(0xE000E018u)
#define COPROCESSORS REGISTER(0xE000ED88u)

static int semihost(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void board_say(const char *text)
{
    semihost(0x04, text);
}

void board_exit(int code)
{
    const uint32_t why[2] = {0x20026u, (uint32_t)code};
    semihost(0x20, why);
    for (;;) {
    }
}

static volatile unsigned rounds;

static void count_round(void) { ++rounds; }

/* One instruction is 128 ns of QEMU's time (-icount shift=7), a tick of SysTick 40 ns; it counts down 24 bits. */
unsigned board_ticks(void)
{
    unsigned before, now;
    do {
        before = rounds;
        now = SYSTICK_NOW;
    } while (before != rounds);
    return (before << 24) - now;
}

unsigned board_instructions(unsigned before, unsigned after)
{
    return (unsigned)(((uint64_t)(after - before) * 5u + 8u) / 16u);
}

static void fault(void)
{
    board_say("fault\n");
    board_exit(1);
}

void reset(void)
{
    uint32_t *from = &_data_from;
    for (uint32_t *to = &_data; to < &_data_end; ++to)
        *to = *from++;
    for (uint32_t *to = &_bss; to < &_bss_end; ++to)
        *to = 0;
    COPROCESSORS |= 0xFu << 20;
    __asm__ volatile("dsb\n isb");
    SYSTICK_RELOAD = 0xFFFFFFu;
    SYSTICK_CONTROL = 7u;
    board_exit(main());
}

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))&_stack, reset, fault, fault, fault, fault, fault, 0, 0, 0, 0, 0, 0, 0, 0, count_round,
};
