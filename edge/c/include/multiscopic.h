/*
 * Depth from one camera that is moved on purpose, on a microcontroller: lines of pixels in, lines of disparities out.
 *
 * A camera takes a centre image and neighbours at known offsets in its image plane. A point at distance Z has the
 * disparity d = f B / Z pixels in all of them: f is the focal length in pixels, B the distance between neighbours, the
 * baseline. The match of the centre's pixel (u, v) in the view (right, down) is at (u - right d, v - down d).
 *
 *     #include "depth.h" // multiscopic budget --width 160 --height 120 --views 2 --num-disparities 16 --header depth.h
 *
 *     static uint32_t memory[DEPTH_MEMORY_WORDS];
 *     static uint16_t disparities[DEPTH_COLUMNS];
 *
 *     static int read_line(void *camera, multiscopic_view view, uint16_t line, uint8_t *pixels) { ... return 0; }
 *
 *     const multiscopic_params params = DEPTH_PARAMS;
 *     multiscopic_matcher *matcher;
 *     uint16_t v;
 *     int status = multiscopic_begin(&DEPTH_METHOD, &params, NULL, memory, DEPTH_MEMORY_WORDS, &matcher);
 *     while (status >= 0 && status != MULTISCOPIC_END) {
 *         status = multiscopic_next_line(matcher, read_line, &camera, disparities, NULL, &v);
 *         if (status == MULTISCOPIC_LINE) { ... disparities of line v ... }
 *     }
 *     if (status < 0) { puts(multiscopic_status_text(status)); }
 *
 * For C99 and later, and C++. Nothing allocates, prints or keeps static state, and nothing blocks but the callback.
 * Matches in memories of their own are independent of each other: one may run in each task or on each core. The memory
 * must not be moved, nor changed, before the match is done with; there is nothing to release.
 */
#ifndef MULTISCOPIC_H
#define MULTISCOPIC_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The most neighbouring views: 4, or 8 where the library is built with its feature `array`. */
#define MULTISCOPIC_MAX_VIEWS 8

/*
 * A position of the camera, in baselines to the right of the centre and below it, each from -16 to 16. (0, 0) is the
 * centre. The neighbours in a row are (-1, 0) and (1, 0), those above and below (0, -1) and (0, 1).
 */
typedef struct multiscopic_view {
    int8_t right;
    int8_t down;
} multiscopic_view;

/* The rule that fuses the matching costs of the views. */
enum multiscopic_fusion {
    MULTISCOPIC_MIN = 0,       /* the least cost: best for one or two views */
    MULTISCOPIC_MEAN = 1,      /* the mean of all costs */
    MULTISCOPIC_HEURISTIC = 2, /* the paper's mean of the two or three least: best for three or four */
    MULTISCOPIC_HALF = 3,      /* the mean of the least half of the costs: best for more */
    MULTISCOPIC_TRIMMED = 4    /* with the census alone: the mean of all distances, or of the best few */
};

/* The window of a census transform, the cost of semi-global matching that bears changes of brightness. */
enum multiscopic_census {
    MULTISCOPIC_NO_CENSUS = 0, /* sums of absolute differences */
    MULTISCOPIC_CENSUS_5X5 = 1,
    MULTISCOPIC_CENSUS_7X7 = 2,
    MULTISCOPIC_CENSUS_9X7 = 3
};

/*
 * A search, and the parameters of its method. The default of a field that is not set, 0, is out of the field's range
 * where it has no meaning of its own, and then refused.
 */
typedef struct multiscopic_params {
    uint16_t width;          /* pixels in a line of a frame, at least 1 */
    uint16_t height;         /* lines of a frame, at least 1 */
    int16_t min_disparity;   /* the smallest disparity that is searched, in pixels */
    uint16_t num_disparities; /* how many are searched, one pixel apart, at least 1. All are within -511..511 */
    multiscopic_view views[MULTISCOPIC_MAX_VIEWS]; /* the neighbouring views, in any order, each once */
    uint8_t num_views;        /* how many there are, at least 1 */
    uint8_t fusion;           /* of enum multiscopic_fusion */
    uint8_t block_size;       /* the side of the block, odd, to 21; for sgm to 11, usually 5, and not read with a census */
    uint8_t uniqueness_ratio; /* percent by which all others have to cost more, or there is no disparity; 0 keeps all */
    uint8_t census;           /* sgm: of enum multiscopic_census. bm has none */
    uint8_t p1;               /* sgm: the penalty for a change by one pixel, not above p2. Read if p2 is not 0 */
    uint8_t p2;               /* sgm: the penalty for a larger change, to 51; 0: all three are those that suit the cost */
    uint8_t p2_edge;          /* sgm: the change of brightness above which p2 is lowered; 0: it never is */
} multiscopic_params;

/* A rectangle of the centre's frame, in pixels. A narrow one takes less memory, and has the bits of the whole frame. */
typedef struct multiscopic_region {
    uint16_t left;
    uint16_t top;
    uint16_t width;
    uint16_t height;
} multiscopic_region;

/* How a call ended. Errors are below 0, and change nothing but what the call says. */
typedef int32_t multiscopic_status;
enum multiscopic_statuses {
    MULTISCOPIC_OK = 0,
    MULTISCOPIC_LINE = 1,                   /* a line was computed */
    MULTISCOPIC_WANTED = 2,                 /* the line that is wanted has to be pushed */
    MULTISCOPIC_END = 3,                    /* the last line was computed before */
    MULTISCOPIC_NULL_POINTER = -1,          /* a pointer is null */
    MULTISCOPIC_EMPTY_FRAME = -2,           /* width or height is 0 */
    MULTISCOPIC_NO_VIEWS = -3,              /* num_views is 0 */
    MULTISCOPIC_TOO_MANY_VIEWS = -4,        /* num_views is above 4, or 8 */
    MULTISCOPIC_INVALID_VIEW = -5,          /* a view is (0, 0), leaves -16..16 or is given twice */
    MULTISCOPIC_INVALID_FUSION = -6,        /* fusion is none of enum multiscopic_fusion, or trimmed without the census */
    MULTISCOPIC_INVALID_RANGE = -7,         /* num_disparities is 0, or a disparity leaves -511..511 */
    MULTISCOPIC_INVALID_BLOCK_SIZE = -8,    /* block_size is even, or too large */
    MULTISCOPIC_INVALID_CENSUS = -9,        /* census is none of enum multiscopic_census, or given to bm */
    MULTISCOPIC_INVALID_PENALTIES = -10,    /* p1 is above p2, or p2 above 51 */
    MULTISCOPIC_INVALID_REGION = -11,       /* empty, beyond the frame, or given to sgm or with confidences */
    MULTISCOPIC_OTHER_METHOD = -12,         /* it takes another number of views, smaller blocks, or no census */
    MULTISCOPIC_MEMORY_TOO_SMALL = -13,     /* fewer words than multiscopic_memory_words() */
    MULTISCOPIC_INVALID_CONFIDENCES = -14,  /* no line for the confidences of a method, or one where it has none */
    MULTISCOPIC_SOURCE_FAILED = -15,        /* the callback did not read the line; the call can be repeated */
    MULTISCOPIC_NOTHING_WANTED = -16,       /* a line was pushed though none was wanted */
    MULTISCOPIC_BUFFER_TOO_SMALL = -17      /* fewer bytes than multiscopic_packet_buffer_bytes() */
};

/* What a status says, as a sentence in ASCII. A program that does not call this has no text in flash. */
const char *multiscopic_status_text(multiscopic_status status);

/*
 * A method, for a number of views. A program links the code of the methods that it names (give the linker
 * --gc-sections), so name the one for your number of views. The last four take any number of views, blocks up to 21 and
 * censuses, and 300 KB of flash: for a host.
 *
 *  - bm is block matching: blocks up to 15.
 *  - sgm is semi-global matching along five paths, on sums of absolute differences: smooth where blocks see nothing,
 *    three times the time.
 *  - _confidence also computes a confidence for each pixel, five lines later.
 */
typedef struct multiscopic_method multiscopic_method;
extern const multiscopic_method multiscopic_bm1, multiscopic_bm1_confidence, multiscopic_sgm1, multiscopic_sgm1_confidence;
extern const multiscopic_method multiscopic_bm2, multiscopic_bm2_confidence, multiscopic_sgm2, multiscopic_sgm2_confidence;
extern const multiscopic_method multiscopic_bm3, multiscopic_bm3_confidence, multiscopic_sgm3, multiscopic_sgm3_confidence;
extern const multiscopic_method multiscopic_bm4, multiscopic_bm4_confidence, multiscopic_sgm4, multiscopic_sgm4_confidence;
/* For five to eight views, where the library is built with its feature `array`. */
extern const multiscopic_method multiscopic_bm8, multiscopic_bm8_confidence, multiscopic_sgm8, multiscopic_sgm8_confidence;
extern const multiscopic_method multiscopic_bm, multiscopic_bm_confidence, multiscopic_sgm, multiscopic_sgm_confidence;

/*
 * The memory of a match in words of 32 bits, or 0 if the method refuses the parameters: multiscopic_begin() then says
 * why. `multiscopic budget --header` tells it beforehand, for a static array.
 */
size_t multiscopic_memory_words(const multiscopic_method *method, const multiscopic_params *params,
                                const multiscopic_region *region);

/* A match that has begun, in the memory that it was lent. */
typedef struct multiscopic_matcher multiscopic_matcher;

/*
 * Begins a match of a region, or of the whole frame if region is NULL, in `words` words of memory with any content, and
 * sets *matcher. The next frame begins in the same way, in the same memory. The parameters are copied.
 *
 * Errors: all from MULTISCOPIC_NULL_POINTER to MULTISCOPIC_MEMORY_TOO_SMALL; *matcher is then NULL.
 */
multiscopic_status multiscopic_begin(const multiscopic_method *method, const multiscopic_params *params,
                                     const multiscopic_region *region, uint32_t *memory, size_t words,
                                     multiscopic_matcher **matcher);

/*
 * Reads a line of the frame of a view into `pixels`, grey values from 0 to 255, as many as the frame is wide. Each line
 * of each frame is read once, from the top down. Returns 0, or anything else if it could not.
 */
typedef int (*multiscopic_read_line)(void *context, multiscopic_view view, uint16_t line, uint8_t *pixels);

/*
 * Computes the next line of the region. Calls `read` with `context` for the lines it needs.
 *
 *  - disparities: one for each column of the region, see multiscopic_pixels().
 *  - confidences: as many, the probability that a disparity is at most a pixel off, times 255; 0 where there is none.
 *    NULL for a method without them.
 *  - line: its number in the frame.
 *
 * Returns MULTISCOPIC_LINE, or MULTISCOPIC_END after the last, or an error: MULTISCOPIC_SOURCE_FAILED,
 * MULTISCOPIC_INVALID_CONFIDENCES, MULTISCOPIC_NULL_POINTER.
 */
multiscopic_status multiscopic_next_line(multiscopic_matcher *matcher, multiscopic_read_line read, void *context,
                                         uint16_t *disparities, uint8_t *confidences, uint16_t *line);

/* A line of the frame of a view. */
typedef struct multiscopic_wanted {
    multiscopic_view view;
    uint16_t line;
} multiscopic_wanted;

/*
 * The same for lines that are pushed as they come, instead of read by a callback: from an interrupt's queue, or a task
 * that waits for DMA. `pixels` is the line that the last call wanted, NULL in the first call and after each line that
 * was computed. It is copied.
 *
 * Returns MULTISCOPIC_WANTED and sets *wanted to the line to push next, MULTISCOPIC_LINE if a line was computed,
 * MULTISCOPIC_END after the last, or an error.
 */
multiscopic_status multiscopic_push_line(multiscopic_matcher *matcher, const uint8_t *pixels, uint16_t *disparities,
                                         uint8_t *confidences, uint16_t *line, multiscopic_wanted *wanted);

/* Bytes to send: they stand in the buffer that they were encoded in. */
typedef struct multiscopic_packet {
    const uint8_t *bytes;
    size_t length;
} multiscopic_packet;

/* The bytes of a buffer to encode lines of so many columns in. */
size_t multiscopic_packet_buffer_bytes(uint16_t columns);

/*
 * Encodes a line that was computed, with its confidences or NULL, for `multiscopic listen` on a host, which turns the
 * packets of a serial port into pictures and names every line that is lost or damaged. Lines are numbered as they are
 * encoded.
 *
 * Returns MULTISCOPIC_OK, MULTISCOPIC_NULL_POINTER or MULTISCOPIC_BUFFER_TOO_SMALL.
 */
multiscopic_status multiscopic_encode_line(multiscopic_matcher *matcher, uint16_t line, const uint16_t *disparities,
                                           const uint8_t *confidences, uint8_t *buffer, size_t buffer_bytes,
                                           multiscopic_packet *packet);

/* The packet that ends a frame, with the greatest depth of the stack in bytes, or 0 if it was not measured. */
multiscopic_status multiscopic_encode_end(multiscopic_matcher *matcher, uint32_t stack_bytes, uint8_t *buffer,
                                          size_t buffer_bytes, multiscopic_packet *packet);

/* A pixel without a disparity. */
#define MULTISCOPIC_NONE 0u

/* A disparity in 1/64 of a pixel. */
static inline int32_t multiscopic_steps(uint16_t disparity) {
    return (int32_t)disparity - 32768;
}

/* A disparity in pixels. */
static inline float multiscopic_pixels(uint16_t disparity) {
    return (float)multiscopic_steps(disparity) / 64.0f;
}

/* The distance of a disparity above 0, in the unit of the baseline: f B / d. The focal length is in pixels. */
static inline float multiscopic_distance(uint16_t disparity, float focal_length, float baseline) {
    return focal_length * baseline / multiscopic_pixels(disparity);
}

/* As the library asserts: both sides lay out memory alike. */
typedef char multiscopic_has_params_of_32_bytes[sizeof(multiscopic_params) == 32 ? 1 : -1];
typedef char multiscopic_has_views_of_2_bytes[sizeof(multiscopic_view) == 2 ? 1 : -1];

#ifdef __cplusplus
}
#endif

#endif
