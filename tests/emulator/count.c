/* A plugin for QEMU that counts the instructions of each phase of a program.
 *
 *     -plugin libcount.so,to=FILE,phase=ADDRESS,phase=ADDRESS,...
 *
 * A phase begins when the function at its address is called. At the end, FILE gets the instructions of each phase, a number per line
 * in the order of the arguments. Nothing is counted before the first phase.
 *
 * Instructions are counted by translated blocks. A call begins a block, so the function at an address is always the beginning of
 * one; the functions' own instructions count for the phase that they begin. The count does not depend on time: the same program
 * with the same input gives the same count at every run.
 *
 * Some systems have QEMU without its header, so the few prototypes are here. They are the same in all versions of the interface;
 * QEMU_PLUGIN_VERSION says which version is asked for.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef QEMU_PLUGIN_VERSION
#define QEMU_PLUGIN_VERSION 1
#endif
#define EXPORT __attribute__((visibility("default")))

typedef uint64_t plugin_id;
struct block;
struct instruction;
enum { NO_REGISTERS = 0 };

extern void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id, void (*)(plugin_id, struct block *));
extern void qemu_plugin_register_vcpu_tb_exec_cb(struct block *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_atexit_cb(plugin_id, void (*)(plugin_id, void *), void *);
extern size_t qemu_plugin_tb_n_insns(const struct block *);
extern struct instruction *qemu_plugin_tb_get_insn(const struct block *, size_t);
extern uint64_t qemu_plugin_insn_vaddr(const struct instruction *);

EXPORT int qemu_plugin_version = QEMU_PLUGIN_VERSION;

enum { MOST_PHASES = 8 };

static uint64_t addresses[MOST_PHASES], counts[MOST_PHASES + 1];
static size_t phases, phase = MOST_PHASES; /* The last one is before the first. */
static char file[4096];

static void enter(unsigned cpu, void *data)
{
    phase = (size_t)data;
}

static void count(unsigned cpu, void *data)
{
    counts[phase] += (size_t)data;
}

static void translated(plugin_id id, struct block *block)
{
    size_t instructions = qemu_plugin_tb_n_insns(block);
    uint64_t address = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(block, 0));
    for (size_t i = 0; i < phases; i++)
        if (addresses[i] == address)
            qemu_plugin_register_vcpu_tb_exec_cb(block, enter, NO_REGISTERS, (void *)i);
    qemu_plugin_register_vcpu_tb_exec_cb(block, count, NO_REGISTERS, (void *)instructions);
}

static void report(plugin_id id, void *data)
{
    FILE *to = fopen(file, "w");
    if (!to) {
        perror(file);
        return;
    }
    for (size_t i = 0; i < phases; i++)
        fprintf(to, "%" PRIu64 "\n", counts[i]);
    fclose(to);
}

EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv)
{
    for (int i = 0; i < argc; i++) {
        if (!strncmp(argv[i], "to=", 3) && strlen(argv[i] + 3) < sizeof file) {
            strcpy(file, argv[i] + 3);
        } else if (!strncmp(argv[i], "phase=", 6) && phases < MOST_PHASES) {
            /* The lowest bit of a function's address stands for Thumb. */
            addresses[phases++] = strtoull(argv[i] + 6, NULL, 0) & ~1ull;
        } else {
            fprintf(stderr, "count: bad argument %s\n", argv[i]);
            return -1;
        }
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, report, NULL);
    return 0;
}
