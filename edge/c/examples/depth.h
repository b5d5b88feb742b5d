/* A match by multiscopic.h, on processors of 32 bits: `multiscopic budget --header` wrote it. */
#define DEPTH_METHOD multiscopic_bm2
#define DEPTH_WIDTH 160
#define DEPTH_HEIGHT 120
#define DEPTH_COLUMNS 160 /* disparities of a line */
#define DEPTH_MEMORY_WORDS 4072
#define DEPTH_PACKET_BUFFER_BYTES 1025
#define DEPTH_PARAMS \
    {160, 120, 1, 16, {{-1, 0}, {1, 0}}, 2, MULTISCOPIC_MIN, 7, 0, MULTISCOPIC_NO_CENSUS, 0, 0, 0}
