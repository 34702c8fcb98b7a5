/* A plugin for qemu-user that counts instructions between getppid() and the next one, and prints mean and most of them.
   Debian has no header of qemu's plugins: what is needed of docs/devel/tcg-plugins (version 1) is declared here. */
#include <stdint.h>
#include <stdio.h>

typedef uint64_t plugin_id;
struct tb;
extern void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id, void (*)(plugin_id, struct tb *));
extern void qemu_plugin_register_vcpu_tb_exec_inline(struct tb *, int add, void *count, uint64_t number);
extern void qemu_plugin_register_vcpu_syscall_cb(plugin_id, void (*)(plugin_id, unsigned, int64_t number, ...));
extern void qemu_plugin_register_atexit_cb(plugin_id, void (*)(plugin_id, void *), void *);
extern uint64_t qemu_plugin_tb_n_insns(const struct tb *);

int qemu_plugin_version = 1;
static uint64_t count, before, total, most, ticks;
static int within;

static void on_block(plugin_id id, struct tb *block) {
    (void)id;
    qemu_plugin_register_vcpu_tb_exec_inline(block, 0, &count, qemu_plugin_tb_n_insns(block));
}

static void on_syscall(plugin_id id, unsigned cpu, int64_t number, ...) {
    (void)id, (void)cpu;
    if (number != 110 && number != 173) return; /* getppid of x86-64, of aarch64 */
    if (within) {
        const uint64_t spent = count - before;
        total += spent, ticks++;
        if (spent > most) most = spent;
    }
    within = !within;
    before = count;
}

static void at_end(plugin_id id, void *none) {
    (void)id, (void)none;
    fprintf(stderr, "%lu %lu\n", (unsigned long)(total / (ticks ? ticks : 1)), (unsigned long)most);
}

int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv) {
    (void)info, (void)argc, (void)argv;
    qemu_plugin_register_vcpu_tb_trans_cb(id, on_block);
    qemu_plugin_register_vcpu_syscall_cb(id, on_syscall);
    qemu_plugin_register_atexit_cb(id, at_end, NULL);
    return 0;
}
