// SPDX-License-Identifier: MIT
/* The same checks as an image in QEMU. Arguments: mode=bits|profiles|cycles|stack feed=PATH out=PATH */
#include <string.h>

#include "check.h"
#include "port/arm/cortexm.h"
#include "port/arm/semihost.h"

#if defined(CHECK_NRF51)
#include "port/nrf51/nrf51.h"
#define timer_init nrf51_timer_init
#define timer_ticks nrf51_timer_ticks
#define INSTRUCTIONS_PER_1000_TICKS 62500u /* 1 ns per instruction (-icount shift=0) at 16 MHz */
#else
#include "port/arm/cmsdk.h"
#define timer_init cmsdk_timer_init
#define timer_ticks cmsdk_timer_ticks
#define INSTRUCTIONS_PER_1000_TICKS 40000u /* at 25 MHz */
#endif

enum { BUFFER_RECORDS = 20, OUT_BYTES = 512 };

static struct {
  char feed_path[160];
  int32_t feed, out;
  size_t at, end, n_out;
  uint8_t records[BUFFER_RECORDS * IMUCAL_SAMPLE_RECORD_BYTES];
  char text[OUT_BYTES];
} host;

void port_fault(void);
void port_fault(void) {
  semihost_print("check: processor fault\n");
  semihost_exit(70);
}

static void flush(void) {
  if (host.n_out && !semihost_write(host.out, host.text, host.n_out)) semihost_exit(4);
  host.n_out = 0;
}

static void print(void* ctx, const char* text) {
  (void)ctx;
  for (; *text; text++) {
    if (host.n_out == sizeof host.text) flush();
    host.text[host.n_out++] = *text;
  }
}

/* A whole number of records at a time: a file delivers all that is asked for, but at its end. */
static bool next_sample(void* ctx, bool is_rewound, imucal_sample_t* sample) {
  (void)ctx;
  if (is_rewound) {
    if (host.feed >= 0) semihost_close(host.feed);
    host.feed = semihost_open(host.feed_path, SEMIHOST_READ);
    host.at = host.end = 0;
  }
  if (host.at == host.end) {
    const int32_t n = host.feed < 0 ? -1 : semihost_read(host.feed, host.records, sizeof host.records);
    if (n < 0) semihost_exit(3);
    host.at = 0;
    host.end = (size_t)n;
  }
  if (host.end - host.at < IMUCAL_SAMPLE_RECORD_BYTES) return false;
  if (imucal_sample_decode(host.records + host.at, sample) != IMUCAL_OK) semihost_exit(3);
  host.at += IMUCAL_SAMPLE_RECORD_BYTES;
  return true;
}

static uint32_t stack_used_bytes(void) {
  return cortexm_stack_size_bytes() - cortexm_stack_free_bytes();
}

int main(void) {
  char command_line[384], path[160], mode[16];
  const check_io_t io = {.sample = next_sample,
                         .print = print,
                         .ticks = timer_ticks,
                         .instructions_per_1000_ticks = INSTRUCTIONS_PER_1000_TICKS,
                         .stack_paint = cortexm_stack_paint,
                         .stack_used_bytes = stack_used_bytes};
  timer_init();
  host.feed = -1;
  if (!semihost_command_line(command_line, sizeof command_line) ||
      !semihost_option(command_line, "mode", mode, sizeof mode) ||
      !semihost_option(command_line, "out", path, sizeof path) || (host.out = semihost_open(path, SEMIHOST_CREATE)) < 0)
    semihost_exit(2);
  if (!semihost_option(command_line, "feed", host.feed_path, sizeof host.feed_path)) host.feed_path[0] = '\0';
  if (!strcmp(mode, "bits"))
    check_bits(&io);
  else if (!strcmp(mode, "profiles"))
    check_profiles(&io);
  else if (!strcmp(mode, "cycles"))
    check_cycles(&io);
  else if (!strcmp(mode, "stack"))
    check_stack(&io);
  else
    semihost_exit(2);
  flush();
  semihost_exit(0);
}
