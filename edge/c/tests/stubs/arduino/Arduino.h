/* What a sketch uses of it, with a main function that runs it once. */
#include <stddef.h>
#include <stdint.h>

extern "C" void write_bytes(const uint8_t *bytes, size_t length);

static struct {
    void begin(unsigned long) {}
    void write(const uint8_t *bytes, size_t length) { write_bytes(bytes, length); }
    void println(const char *) {}
} Serial;

void setup();
void loop();

int main() {
    setup();
    loop();
    return 0;
}
