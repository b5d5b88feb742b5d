/* A plugin for QEMU that counts the instructions of each phase of a program.
 *
 *     -plugin libcount.so,to=FILE,phase=ADDRESS,phase=ADDRESS,...,blocks=FILE
 *
 * A phase begins when the function at its address is called. At the end, FILE gets the instructions of each phase, a number per
 * line in the order of the arguments. Nothing is counted before the first phase.
 *
 * With `blocks`, that file gets a line for each pair of translated blocks that ran one after the other: the number of the second
 * block's phase, the address in hexadecimal and the number of instructions of both blocks, how often, and the additional accesses
 * of the second block if each access to an unaligned address is split into aligned ones.
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
struct translation;
struct instruction;
enum { NO_REGISTERS = 0, READS_AND_WRITES = 3 };

extern void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id, void (*)(plugin_id, struct translation *));
extern void qemu_plugin_register_vcpu_tb_exec_cb(struct translation *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_atexit_cb(plugin_id, void (*)(plugin_id, void *), void *);
extern size_t qemu_plugin_tb_n_insns(const struct translation *);
extern struct instruction *qemu_plugin_tb_get_insn(const struct translation *, size_t);
extern uint64_t qemu_plugin_insn_vaddr(const struct instruction *);
extern void qemu_plugin_register_vcpu_mem_cb(struct instruction *, void (*)(unsigned, uint32_t, uint64_t, void *), int, int, void *);
extern unsigned qemu_plugin_mem_size_shift(uint32_t);

EXPORT int qemu_plugin_version = QEMU_PLUGIN_VERSION;

enum { MOST_PHASES = 8 };

/* A block, and the blocks that ran after it, the latest first. */
struct block {
    uint64_t address;
    size_t instructions;
    struct successor *successors;
    struct block *older;
};
struct successor {
    struct block *block;
    uint64_t counts[MOST_PHASES + 1], splits[MOST_PHASES + 1];
    struct successor *next;
};

static uint64_t addresses[MOST_PHASES], counts[MOST_PHASES + 1];
static size_t phases, phase = MOST_PHASES; /* The last one is before the first. */
static char file[4096], blocks_file[4096];
static struct block *newest, *running;
static struct successor *succession; /* By which the running block began. */

static void *zeroed(size_t bytes)
{
    void *memory = calloc(1, bytes);
    if (!memory)
        abort();
    return memory;
}

static void enter(unsigned cpu, void *data)
{
    phase = (size_t)data;
}

static void count(unsigned cpu, void *data)
{
    counts[phase] += ((struct block *)data)->instructions;
}

static void follow(unsigned cpu, void *data)
{
    struct block *block = data, *from = running;
    running = block;
    if (!from)
        return;
    struct successor **link = &from->successors;
    while (*link && (*link)->block != block)
        link = &(*link)->next;
    struct successor *successor = *link;
    if (!successor) {
        successor = zeroed(sizeof *successor);
        successor->block = block;
    } else {
        *link = successor->next;
    }
    successor->next = from->successors;
    from->successors = successor;
    successor->counts[phase]++;
    succession = successor;
}

static void access(unsigned cpu, uint32_t kind, uint64_t address, void *data)
{
    uint64_t bytes = 1ull << qemu_plugin_mem_size_shift(kind);
    /* At an odd address, a byte, a half-word and a byte instead of a word. */
    if (succession && address % bytes)
        succession->splits[phase] += address % 2 && bytes > 2 ? 2 : 1;
}

static void translated(plugin_id id, struct translation *translation)
{
    struct block *block = zeroed(sizeof *block);
    block->instructions = qemu_plugin_tb_n_insns(translation);
    block->address = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(translation, 0));
    block->older = newest;
    newest = block;
    for (size_t i = 0; i < phases; i++)
        if (addresses[i] == block->address)
            qemu_plugin_register_vcpu_tb_exec_cb(translation, enter, NO_REGISTERS, (void *)i);
    qemu_plugin_register_vcpu_tb_exec_cb(translation, count, NO_REGISTERS, block);
    if (!*blocks_file)
        return;
    qemu_plugin_register_vcpu_tb_exec_cb(translation, follow, NO_REGISTERS, block);
    for (size_t i = 0; i < block->instructions; i++)
        qemu_plugin_register_vcpu_mem_cb(qemu_plugin_tb_get_insn(translation, i), access, NO_REGISTERS, READS_AND_WRITES, NULL);
}

static FILE *created(const char *path)
{
    FILE *to = fopen(path, "w");
    if (!to)
        perror(path);
    return to;
}

static void report(plugin_id id, void *data)
{
    FILE *to = created(file);
    if (to) {
        for (size_t i = 0; i < phases; i++)
            fprintf(to, "%" PRIu64 "\n", counts[i]);
        fclose(to);
    }
    if (!*blocks_file || !(to = created(blocks_file)))
        return;
    for (const struct block *from = newest; from; from = from->older)
        for (const struct successor *s = from->successors; s; s = s->next)
            for (size_t i = 0; i < phases; i++)
                if (s->counts[i])
                    fprintf(to, "%zu %" PRIx64 " %zu %" PRIx64 " %zu %" PRIu64 " %" PRIu64 "\n", i, from->address,
                            from->instructions, s->block->address, s->block->instructions, s->counts[i], s->splits[i]);
    fclose(to);
}

EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv)
{
    for (int i = 0; i < argc; i++) {
        if (!strncmp(argv[i], "to=", 3) && strlen(argv[i] + 3) < sizeof file) {
            strcpy(file, argv[i] + 3);
        } else if (!strncmp(argv[i], "blocks=", 7) && strlen(argv[i] + 7) < sizeof blocks_file) {
            strcpy(blocks_file, argv[i] + 7);
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
