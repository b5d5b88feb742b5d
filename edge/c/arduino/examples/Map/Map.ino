// Matches frames of 160x120 pixels with two neighbours, and sends packets for `multiscopic listen`.
#include <multiscopic.h>

const uint16_t width = 160, height = 120;
static uint32_t memory[4800];
static uint16_t disparities[width];
static uint8_t buffer[1024];

static uint8_t texture(int32_t u, int32_t v) {
  return (u * u * 31 + v * v * 17 + u * v * 7) >> 3;
}

// Your camera takes its place: here, a box 9 pixels away from its place in the neighbours, before a wall 2 pixels away.
static int readLine(void *, multiscopic_view view, uint16_t line, uint8_t *pixels) {
  for (int32_t u = 0; u < width; u++) {
    int32_t near = u + 9 * view.right, far = u + 2 * view.right;
    bool isBox = near >= 50 && near < 110 && line >= 30 && line < 90;
    pixels[u] = texture(isBox ? near + 1000 : far, line);
  }
  return 0;
}

void setup() {
  Serial.begin(115200);
}

void loop() {
  multiscopic_params params = {};
  params.width = width;
  params.height = height;
  params.min_disparity = 1;
  params.num_disparities = 16;
  params.views[0].right = -1;
  params.views[1].right = 1;
  params.num_views = 2;
  params.fusion = MULTISCOPIC_MIN;
  params.block_size = 7;

  multiscopic_matcher *matcher;
  multiscopic_packet packet;
  uint16_t line;
  multiscopic_status status = multiscopic_begin(&multiscopic_bm2, &params, NULL, memory, sizeof memory / sizeof *memory, &matcher);
  while (status >= 0 && status != MULTISCOPIC_END) {
    status = multiscopic_next_line(matcher, readLine, NULL, disparities, NULL, &line);
    if (status == MULTISCOPIC_LINE) {
      status = multiscopic_encode_line(matcher, line, disparities, NULL, buffer, sizeof buffer, &packet);
      Serial.write(packet.bytes, packet.length);
    }
  }
  if (status >= 0 && multiscopic_encode_end(matcher, 0, buffer, sizeof buffer, &packet) == MULTISCOPIC_OK) {
    Serial.write(packet.bytes, packet.length);
  }
  if (status < 0) {
    Serial.println(multiscopic_status_text(status));
  }
}
