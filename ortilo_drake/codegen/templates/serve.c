/* Flies the exported half for a program at the other end of standard input and output; on an emulated board of Arm's
   MPS2, of its serial port. Each request is 1 to begin anew or 0, and the inputs; each answer is how many functions had
   to stop, and the outputs. */
#include <stdint.h>
#include <stdio.h>

#include "ortilo.h"

#ifdef __ARM_ARCH_7EM__
/* Data, state (1: cannot send, 2: has received), control, interrupts, divider. The processor waits asleep for a byte: its
   interrupt 0 is masked and only wakes it. */
#define UART ((volatile uint32_t *)0x40004000)
#define ENABLED (*(volatile uint32_t *)0xE000E100)
#define NOT_PENDING (*(volatile uint32_t *)0xE000E280)

static int get(void *values, size_t size) {
    for (size_t i = 0; i < size; i++) {
        while (!(UART[1] & 2)) __asm volatile("wfi");
        ((uint8_t *)values)[i] = (uint8_t)UART[0];
        UART[3] = 2, NOT_PENDING = 1;
    }
    return 1;
}

static void put(const void *values, size_t size) {
    for (size_t i = 0; i < size; i++) {
        while (UART[1] & 1) {
        }
        UART[0] = ((const uint8_t *)values)[i];
    }
}

static void begin(void) {
    __asm volatile("cpsid i");
    UART[4] = 16, UART[2] = 1 | 2 | 8, ENABLED = 1;
}
#else
static int get(void *values, size_t size) { return fread(values, size, 1, stdin) == 1; }
static void put(const void *values, size_t size) { fwrite(values, size, 1, stdout); }
static void begin(void) {}
#endif

int main(void) {
    static ortilo half;
    static ortilo_inputs inputs;
    static ortilo_outputs outputs;
    int32_t word;
    begin();
    while (get(&word, sizeof word) && get(&inputs, sizeof inputs)) {
        if (word == 1) ortilo_init(&half, NULL);
        word = ortilo_tick(&half, &inputs, &outputs);
        put(&word, sizeof word);
        put(&outputs, sizeof outputs);
        fflush(stdout);
    }
    return 0;
}
