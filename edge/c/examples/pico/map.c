/* Prints the map of ../map.c every five seconds. */
#include "pico/stdlib.h"

#define main print_map
#include "../map.c"
#undef main

int main(void) {
    stdio_init_all();
    for (;;) {
        print_map();
        sleep_ms(5000);
    }
}
