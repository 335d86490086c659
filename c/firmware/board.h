#ifndef BOARD_H
#define BOARD_H

void board_say(const char *text);
void board_exit(int code);
unsigned board_ticks(void);
/* Between two readings, fewer than 1,300 million. */
unsigned board_instructions(unsigned before, unsigned after);

#endif
