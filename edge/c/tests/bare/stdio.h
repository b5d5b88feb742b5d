/* What board.c has of it. */
int putchar(int character);
int puts(const char *text);
