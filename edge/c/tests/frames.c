/*
 * Matches the cases of cases.h, and writes their packets, for a test that compares them with those of the core. It is C99 and C++.
 *
 * Ends with 0, or with the number of the line below that failed.
 */
#include "multiscopic.h"
#include "cases.h"

/* Of the machine. */
#ifdef __cplusplus
extern "C"
#endif
void write_bytes(const uint8_t *bytes, size_t length);

static uint32_t memory[MEMORY_WORDS];
static uint8_t buffer[BUFFER_BYTES], confidences[MOST_COLUMNS], pixels[MOST_COLUMNS];
static uint16_t disparities[MOST_COLUMNS];

/* A box, which is five pixels away from its place in a neighbour, before a wall one pixel away. */
static int read_line(void *context, multiscopic_view view, uint16_t line, uint8_t *pixel) {
    const multiscopic_params *params = (const multiscopic_params *)context;
    int32_t u;
    for (u = 0; u < params->width; u++) {
        int32_t near_u = u + 5 * view.right, near_v = line + 5 * view.down, far_u = u + view.right, far_v = line + view.down;
        int is_box = near_u >= 20 && near_u < 50 && near_v >= 10 && near_v < 30;
        int32_t x = is_box ? near_u + 1000 : far_u, y = is_box ? near_v : far_v;
        *pixel++ = (uint8_t)((x * x * 31 + y * y * 17 + x * y * 7) >> 3);
    }
    return 0;
}

static int fails_once(void *context, multiscopic_view view, uint16_t line, uint8_t *pixel) {
    static int calls;
    return ++calls % 7 == 0 ? 1 : read_line(context, view, line, pixel);
}

#define ENSURE(condition) if (!(condition)) { return __LINE__; }

static int match(const test_case *given) {
    multiscopic_matcher *matcher;
    multiscopic_packet packet;
    multiscopic_status status;
    multiscopic_wanted wanted;
    uint16_t line = 0;
    const uint8_t *pushed = NULL;
    void *context = (void *)&given->params;
    const multiscopic_region *region = given->has_region ? &given->region : NULL;
    uint8_t *of_line = given->has_confidences ? confidences : NULL;
    size_t words = multiscopic_memory_words(given->method, &given->params, region);

    ENSURE(words > 0 && words <= MEMORY_WORDS);
    ENSURE(multiscopic_begin(given->method, &given->params, region, memory, words - 1, &matcher) == MULTISCOPIC_MEMORY_TOO_SMALL);
    ENSURE(matcher == NULL);
    ENSURE(multiscopic_begin(given->method, &given->params, region, memory, words, &matcher) == MULTISCOPIC_OK);
    do {
        if (given->is_pushed) {
            status = multiscopic_push_line(matcher, pushed, disparities, of_line, &line, &wanted);
            pushed = NULL;
            if (status == MULTISCOPIC_WANTED) {
                ENSURE(read_line(context, wanted.view, wanted.line, pixels) == 0);
                pushed = pixels;
            }
        } else {
            status = multiscopic_next_line(matcher, fails_once, context, disparities, of_line, &line);
        }
        if (status == MULTISCOPIC_LINE) {
            ENSURE(multiscopic_encode_line(matcher, line, disparities, of_line, buffer, BUFFER_BYTES, &packet) == MULTISCOPIC_OK);
            write_bytes(packet.bytes, packet.length);
        }
    } while (status == MULTISCOPIC_LINE || status == MULTISCOPIC_WANTED || status == MULTISCOPIC_SOURCE_FAILED);
    ENSURE(status == MULTISCOPIC_END);
    ENSURE(multiscopic_push_line(matcher, pixels, disparities, of_line, &line, &wanted) == MULTISCOPIC_NOTHING_WANTED);
    ENSURE(multiscopic_encode_end(matcher, 0, buffer, BUFFER_BYTES, &packet) == MULTISCOPIC_OK);
    write_bytes(packet.bytes, packet.length);
    return 0;
}

static multiscopic_status begin(const multiscopic_method *method, const multiscopic_params *params, const multiscopic_region *region) {
    multiscopic_matcher *matcher;
    return multiscopic_begin(method, params, region, memory, MEMORY_WORDS, &matcher);
}

/* Each parameter that is out of its range is refused by its name. */
static int refusals(void) {
    static multiscopic_params valid;
    multiscopic_params params;
    multiscopic_region outside = {0, 0, 17, 1};
    multiscopic_matcher *matcher;
    multiscopic_packet packet;
    uint16_t line;

    valid.width = valid.height = valid.num_disparities = 16;
    valid.views[0].right = -1;
    valid.views[1].right = 1;
    valid.num_views = 2;
    valid.block_size = 5;
#define REFUSED(method, field, value, status) \
    params = valid;                            \
    params.field = value;                      \
    ENSURE(begin(&method, &params, NULL) == status && multiscopic_memory_words(&method, &params, NULL) == 0)
    ENSURE(begin(&multiscopic_bm2, &valid, NULL) == MULTISCOPIC_OK);
    ENSURE(begin(NULL, &valid, NULL) == MULTISCOPIC_NULL_POINTER);
    REFUSED(multiscopic_bm2, width, 0, MULTISCOPIC_EMPTY_FRAME);
    REFUSED(multiscopic_bm2, num_views, 0, MULTISCOPIC_NO_VIEWS);
    REFUSED(multiscopic_bm2, num_views, 9, MULTISCOPIC_TOO_MANY_VIEWS);
    REFUSED(multiscopic_bm2, num_views, 1, MULTISCOPIC_OTHER_METHOD);
    REFUSED(multiscopic_bm2, views[1].right, -1, MULTISCOPIC_INVALID_VIEW);
    REFUSED(multiscopic_bm2, views[1].right, 17, MULTISCOPIC_INVALID_VIEW);
    REFUSED(multiscopic_bm2, fusion, MULTISCOPIC_TRIMMED, MULTISCOPIC_INVALID_FUSION);
    REFUSED(multiscopic_bm2, fusion, 5, MULTISCOPIC_INVALID_FUSION);
    REFUSED(multiscopic_bm2, num_disparities, 0, MULTISCOPIC_INVALID_RANGE);
    REFUSED(multiscopic_bm2, min_disparity, 500, MULTISCOPIC_INVALID_RANGE);
    REFUSED(multiscopic_bm2, block_size, 6, MULTISCOPIC_INVALID_BLOCK_SIZE);
    REFUSED(multiscopic_bm2, block_size, 17, MULTISCOPIC_OTHER_METHOD);
    REFUSED(multiscopic_sgm2, block_size, 13, MULTISCOPIC_INVALID_BLOCK_SIZE);
    REFUSED(multiscopic_bm2, census, MULTISCOPIC_CENSUS_5X5, MULTISCOPIC_INVALID_CENSUS);
    REFUSED(multiscopic_sgm2, census, MULTISCOPIC_CENSUS_5X5, MULTISCOPIC_OTHER_METHOD);
    REFUSED(multiscopic_sgm2, census, 4, MULTISCOPIC_INVALID_CENSUS);
    REFUSED(multiscopic_sgm2, p2, 52, MULTISCOPIC_INVALID_PENALTIES);
    ENSURE(begin(&multiscopic_bm2, &valid, &outside) == MULTISCOPIC_INVALID_REGION);
    outside.width = 8;
    ENSURE(begin(&multiscopic_bm2, &valid, &outside) == MULTISCOPIC_OK);
    ENSURE(begin(&multiscopic_sgm2, &valid, &outside) == MULTISCOPIC_INVALID_REGION);
    ENSURE(begin(&multiscopic_bm2_confidence, &valid, &outside) == MULTISCOPIC_INVALID_REGION);

    ENSURE(multiscopic_begin(&multiscopic_bm2, &valid, NULL, memory, MEMORY_WORDS, &matcher) == MULTISCOPIC_OK);
    ENSURE(multiscopic_next_line(matcher, read_line, &valid, disparities, confidences, &line) == MULTISCOPIC_INVALID_CONFIDENCES);
    ENSURE(multiscopic_next_line(NULL, read_line, &valid, disparities, NULL, &line) == MULTISCOPIC_NULL_POINTER);
    ENSURE(multiscopic_next_line(matcher, NULL, &valid, disparities, NULL, &line) == MULTISCOPIC_NULL_POINTER);
    ENSURE(multiscopic_next_line(matcher, read_line, &valid, NULL, NULL, &line) == MULTISCOPIC_NULL_POINTER);
    ENSURE(multiscopic_next_line(matcher, read_line, &valid, disparities, NULL, &line) == MULTISCOPIC_LINE && line == 0);
    ENSURE(multiscopic_encode_line(matcher, 0, disparities, NULL, buffer, 8, &packet) == MULTISCOPIC_BUFFER_TOO_SMALL);
    ENSURE(multiscopic_status_text(MULTISCOPIC_BUFFER_TOO_SMALL)[0] == 't' && multiscopic_status_text(-99)[0] == 't');
    return 0;
}

int main(void) {
    size_t i;
    int failed = refusals();
    for (i = 0; failed == 0 && i < sizeof(cases) / sizeof(cases[0]); i++) {
        failed = match(&cases[i]);
    }
    return failed;
}
