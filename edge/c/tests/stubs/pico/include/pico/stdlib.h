/* What the example calls of it. */
#include <stdint.h>

static inline void stdio_init_all(void) {}
static inline void sleep_ms(uint32_t ms) { (void)ms; }
