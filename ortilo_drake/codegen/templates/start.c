/* Starts a program on qemu's boards of Arm's MPS2 with a Cortex-M: floating point on, then newlib's start. */
#include <stdint.h>

extern void _start(void);

void reset(void) {
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20;
    __asm volatile("dsb\nisb");
    _start();
    for (;;) {
    }
}

static void stuck(void) {
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) const void *vectors[16] = {
    (void *)0x203F0000, (void *)reset, (void *)stuck, (void *)stuck, (void *)stuck, (void *)stuck, (void *)stuck};
