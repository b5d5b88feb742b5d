/* Matches frames of 160x120 pixels with two neighbours, and prints a map of the disparities. */
#include <stdio.h>

#include "multiscopic.h"

#include "depth.h" /* multiscopic budget --profile qqvga --header depth.h */

/* The state has pointers, which are longer on a host. */
#define MEMORY_WORDS (DEPTH_MEMORY_WORDS + (sizeof(void *) > 4 ? 260 : 0))

static uint32_t memory[MEMORY_WORDS];
static uint16_t disparities[DEPTH_COLUMNS];

static uint8_t texture(int32_t u, int32_t v) {
    return (uint8_t)((u * u * 31 + v * v * 17 + u * v * 7) >> 3);
}

/* Your camera takes its place: here, a box 9 pixels away from its place in the neighbours, before a wall 2 pixels away. */
static int read_line(void *camera, multiscopic_view view, uint16_t line, uint8_t *pixels) {
    int32_t u;
    (void)camera;
    for (u = 0; u < DEPTH_WIDTH; u++) {
        int32_t near = u + 9 * view.right, far = u + 2 * view.right;
        int is_box = near >= 50 && near < 110 && line >= 30 && line < 90;
        pixels[u] = texture(is_box ? near + 1000 : far, line); /* the box has another part of the texture */
    }
    return 0;
}

int main(void) {
    static const multiscopic_params params = DEPTH_PARAMS;
    multiscopic_matcher *matcher;
    uint16_t line, u;
    multiscopic_status status = multiscopic_begin(&DEPTH_METHOD, &params, NULL, memory, MEMORY_WORDS, &matcher);

    while (status >= 0 && status != MULTISCOPIC_END) {
        status = multiscopic_next_line(matcher, read_line, NULL, disparities, NULL, &line);
        if (status == MULTISCOPIC_LINE && line % 8 == 4) {
            for (u = 2; u < DEPTH_COLUMNS; u += 4) {
                putchar(disparities[u] == MULTISCOPIC_NONE ? ' ' : '0' + (multiscopic_steps(disparities[u]) + 32) / 64);
            }
            putchar('\n');
        }
    }
    if (status < 0) {
        puts(multiscopic_status_text(status));
        return 1;
    }
    return 0;
}
