/* The output of frames.c on a host: its standard output. */
#include <stdint.h>
#include <stdio.h>

void write_bytes(const uint8_t *bytes, size_t length) {
    fwrite(bytes, 1, length, stdout);
}
