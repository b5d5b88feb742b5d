// Matches frames of 160x120 pixels with two neighbours, and sends packets for `multiscopic listen`.
#include <multiscopic.h>
#include "depth.h" // multiscopic budget --profile qqvga --header depth.h

static uint32_t memory[DEPTH_MEMORY_WORDS];
static uint16_t disparities[DEPTH_COLUMNS];
static uint8_t buffer[DEPTH_PACKET_BUFFER_BYTES];

static uint8_t texture(int32_t u, int32_t v) {
  return (u * u * 31 + v * v * 17 + u * v * 7) >> 3;
}

// Your camera takes its place: here, a box 9 pixels away from its place in the neighbours, before a wall 2 pixels away.
static int readLine(void *, multiscopic_view view, uint16_t line, uint8_t *pixels) {
  for (int32_t u = 0; u < DEPTH_WIDTH; u++) {
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
  static const multiscopic_params params = DEPTH_PARAMS;
  multiscopic_matcher *matcher;
  multiscopic_packet packet;
  uint16_t line;
  multiscopic_status status = multiscopic_begin(&DEPTH_METHOD, &params, NULL, memory, DEPTH_MEMORY_WORDS, &matcher);
  while (status >= 0 && status != MULTISCOPIC_END) {
    status = multiscopic_next_line(matcher, readLine, NULL, disparities, NULL, &line);
    if (status == MULTISCOPIC_LINE) {
      status = multiscopic_encode_line(matcher, line, disparities, NULL, buffer, DEPTH_PACKET_BUFFER_BYTES, &packet);
      Serial.write(packet.bytes, packet.length);
    }
  }
  if (status >= 0 && multiscopic_encode_end(matcher, 0, buffer, DEPTH_PACKET_BUFFER_BYTES, &packet) == MULTISCOPIC_OK) {
    Serial.write(packet.bytes, packet.length);
  }
  if (status < 0) {
    Serial.println(multiscopic_status_text(status));
  }
}
