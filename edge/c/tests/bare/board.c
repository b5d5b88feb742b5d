/* The start of a program on an emulated Cortex-M or RISC-V, and its output through semihosting: what an SDK has on a real board. */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

extern uint32_t _stack_start[], data_load[], data_start[], data_end[], bss_start[], bss_end[];
int main(void);
void reset(void);

enum { OPEN = 0x01, WRITE_TEXT = 0x04, WRITE = 0x05, EXIT = 0x20 };

static intptr_t semihosting(uintptr_t operation, const void *argument) {
#ifdef __riscv
    register uintptr_t a0 __asm__("a0") = operation;
    register const void *a1 __asm__("a1") = argument;
    __asm__ volatile(".option push\n.option norvc\n.balign 16\nslli x0, x0, 0x1f\nebreak\nsrai x0, x0, 7\n.option pop"
                     : "+r"(a0) : "r"(a1) : "memory");
    return (intptr_t)a0;
#else
    register uintptr_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return (intptr_t)r0;
#endif
}

/* To the file `frames.packets`. */
void write_bytes(const uint8_t *bytes, size_t length) {
    static intptr_t file;
    if (file == 0) {
        static const char name[] = "frames.packets";
        const uintptr_t open[3] = {(uintptr_t)name, 5, sizeof(name) - 1}; /* "wb" */
        file = semihosting(OPEN, open);
    }
    const uintptr_t write[3] = {(uintptr_t)file, (uintptr_t)bytes, length};
    semihosting(WRITE, write);
}

int putchar(int character) {
    const char text[2] = {(char)character, 0};
    semihosting(WRITE_TEXT, text);
    return character;
}

int puts(const char *text) {
    semihosting(WRITE_TEXT, text);
    return putchar('\n');
}

__attribute__((noreturn, used)) static void start(void) {
    uint32_t *to = data_start;
    for (const uint32_t *from = data_load; to < data_end;) {
        *to++ = *from++;
    }
    for (to = bss_start; to < bss_end;) {
        *to++ = 0;
    }
#ifndef __riscv
    /* The floating point unit, and the vectors that share its registers. */
    *(volatile uint32_t *)0xe000ed88 |= 0xfu << 20;
    __asm__ volatile("dsb\nisb");
#endif
    const uintptr_t exit[2] = {0x20026, (uintptr_t)main()};
    semihosting(EXIT, exit);
    for (;;) {
    }
}

#ifdef __riscv
__attribute__((naked, section(".vectors"))) void reset(void) {
    __asm__ volatile("la sp, _stack_start\nj start");
}
#else
void reset(void) {
    start();
}

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*reset)(void);
} vectors = {_stack_start, reset};
#endif
