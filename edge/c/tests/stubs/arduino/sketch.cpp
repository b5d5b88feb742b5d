// What Arduino makes of a sketch.
#include "Arduino.h"

#include "Map.ino"
