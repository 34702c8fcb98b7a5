/* Plays golden.h and prints the processor's time of a tick, mean and most, and the deepest stack of a tick. */
#include <stdio.h>
#include <string.h>

#include "golden.h"
#include "ortilo.h"

#ifdef __arm__ /* a board of Arm's, whose counter runs down */
#define SYST_CSR (*(volatile uint32_t *)0xE000E010)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018)
static void start(void) { SYST_RVR = 0xFFFFFF, SYST_CVR = 0, SYST_CSR = 5; }
static uint32_t now(void) { return SYST_CVR; }
#else /* under qemu-user: count.c counts from call to call */
#include <unistd.h>
static void start(void) {}
static uint32_t now(void) { return (uint32_t)getppid(); }
#endif
#define ROOM 30000

static ortilo half;
static ortilo_inputs inputs;
static ortilo_outputs outputs;

static int __attribute__((noinline)) stack_of_tick(void) {
    uint8_t here;
    volatile uint8_t *low = &here - ROOM;
    for (int i = 0; i < ROOM - 200; i++) low[i] = 0xA5;
    ortilo_tick(&half, &inputs, &outputs);
    int i = 0;
    while (i < ROOM - 200 && low[i] == 0xA5) i++;
    return ROOM - i;
}

int main(void) {
    uint64_t total = 0;
    uint32_t most = 0;
    int stack = 0;
    ortilo_init(&half, NULL);
    start();
    for (int k = 0; k < TICKS; k++) {
        memcpy(&inputs, golden_inputs[k], sizeof inputs);
        uint32_t before = now();
        ortilo_tick(&half, &inputs, &outputs);
        uint32_t spent = (before - now()) & 0xFFFFFF;
        total += spent;
        if (spent > most) most = spent;
    }
    ortilo_init(&half, NULL);
    for (int k = 0; k < TICKS; k++) {
        memcpy(&inputs, golden_inputs[k], sizeof inputs);
        int deep = stack_of_tick();
        if (deep > stack) stack = deep;
    }
    printf("%lu %lu %d\n", (unsigned long)(total / TICKS), (unsigned long)most, stack);
    return 0;
}
