// SPDX-License-Identifier: MIT
/* The device as a process: serial line = pseudo-terminal or TCP, sensor = a stream of records, flash = a
 * file. */
#include <errno.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "app/app.h"
#include "bus_pipe.h"
#include "feed.h"
#include "nor_file.h"
#include "port/sim/board_options.h"
#include "serial.h"

#define SLOT_BYTES 4096u
#define PAGE_BYTES 1024u

enum { EXIT_USAGE_ERROR = 2, EXIT_POWER_CUT = 9 };

typedef struct {
  serial_t serial;
  feed_t feed;
  sample_stream_t samples;
  uint8_t sample_bytes[65536];
  bus_sensor_t sensor;
  nor_t nor;
  struct timespec start;
  const char* link_path;
  bool is_reboot_asked;
  unsigned flash_delay_us;
} device_t;

static device_t device;
static imucal_app_t app;
static imucal_board_t board;

static const char kHelp[] =
    "usage: imucal [options]     the device's firmware as a process of this machine\n"
    "  --serial pty|tcp:PORT  serial line (default pty); its name is printed as 'serial NAME'\n"
    "  --link PATH            make PATH a symbolic link to the pseudo-terminal\n"
    "  --feed PATH|tcp:HOST:PORT  raw samples: file, named pipe or server (default: a sensor that is "
    "silent)\n"
    "  --sensor NAME          instead of a feed: a driver (icm42688p, mpu6050, mpu6500, lsm6dso, bmi088) ...\n"
    "  --bus PREFIX           ... and its bus, the pipes PREFIX.request and PREFIX.answer to a model\n"
    "  --flash FILE           flash in this file (default: in memory, lost at exit)\n"
    "  --cut OPERATION[:BYTE] lose power in this erase or program (from 0) after BYTE bytes: exit status 9\n"
    "  --flash-delay-us N     time per erase and per programmed word (default 0)\n"
    "  --live                 behave as with a real sensor: samples are taken always, records that do not "
    "fit are\n"
    "                         dropped\n"
    "  --serial-number TEXT   of the device (default 0001)\n"
    "  --channels N           1 to 6 (default 3)\n"
    "  --names LIST           gx_dph,gy_dph,gz_dph,ax_mg,ay_mg,az_mg\n"
    "  --scale LIST           unit per count (default 1,1,1,0.01): dph for gyros, mg for accelerometers\n"
    "  --full-scale LIST      counts at the rail (default 8388607)\n"
    "  --temp-scale N         degC per count (default 0.01)      --temp-zero N   degC at 0 counts (default "
    "25)\n"
    "  --rate HZ              nominal samples per second (default 100)\n";

/* ---- callbacks ---- */

static size_t port_serial_read(void* ctx, uint8_t* data, size_t capacity) {
  return serial_read(&((device_t*)ctx)->serial, data, capacity);
}

static size_t port_serial_write(void* ctx, const uint8_t* data, size_t length) {
  return serial_write(&((device_t*)ctx)->serial, data, length);
}

static imucal_port_sample_t port_sample_read(void* ctx, imucal_sample_t* sample) {
  device_t* self = ctx;
  switch (sample_stream_next(&self->samples, sample)) {
  case 1:
    return IMUCAL_PORT_SAMPLE;
  case STREAM_BAD_RECORD:
    return IMUCAL_PORT_BAD_SAMPLE;
  case STREAM_ENDED:
    return IMUCAL_PORT_ENDED;
  case STREAM_FAILED:
    fprintf(stderr, "imucal: --feed %s: %s\n", self->feed.where, strerror(errno));
    return IMUCAL_PORT_FAILED;
  default:
    return IMUCAL_PORT_NO_SAMPLE;
  }
}

static imucal_port_sample_t port_bus_read(void* ctx, imucal_sample_t* sample) {
  return bus_sensor_read(&((device_t*)ctx)->sensor, sample);
}

static void port_bus_enable(void* ctx, bool is_wanted) {
  if (is_wanted) bus_sensor_restart_if_ended(&((device_t*)ctx)->sensor);
}

static void port_bus_report(void* ctx, imucal_link_sensor_reply_t* report) {
  bus_sensor_report(&((device_t*)ctx)->sensor, report);
}

static void port_sample_enable(void* ctx, bool is_wanted) {
  device_t* self = ctx;
  if (is_wanted && feed_restart_if_ended(&self->feed)) sample_stream_clear(&self->samples);
}

static uint32_t flash_offset(uint32_t slot, uint32_t offset) {
  return slot * SLOT_BYTES + offset;
}

static imucal_status flash_status(nor_result_t result) {
  if (result != NOR_OK) fprintf(stderr, "imucal: flash refuses: rule %d\n", (int)result);
  return result == NOR_OK ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}

static void flash_delay(const device_t* self, uint32_t n) {
  if (self->flash_delay_us) usleep(self->flash_delay_us * n);
}

static imucal_status port_flash_erase(void* ctx, uint32_t slot) {
  device_t* self = ctx;
  flash_delay(self, 1);
  return flash_status(nor_erase(&self->nor, flash_offset(slot, 0), SLOT_BYTES));
}

static imucal_status port_flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  device_t* self = ctx;
  if (!self->flash_delay_us) return flash_status(nor_program(&self->nor, flash_offset(slot, offset), data, len));
  for (uint32_t at = 0; at < len; at += 4) { /* word by word, so that a kill finds it half done */
    flash_delay(self, 1);
    const nor_result_t result = nor_program(&self->nor, flash_offset(slot, offset + at), data + at, 4);
    if (result != NOR_OK) return flash_status(result);
  }
  return IMUCAL_OK;
}

static imucal_status port_flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  return flash_status(nor_read(&((device_t*)ctx)->nor, flash_offset(slot, offset), data, len));
}

static uint64_t port_time_us(void* ctx) {
  const device_t* self = ctx;
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)((int64_t)(now.tv_sec - self->start.tv_sec) * 1000000 + (now.tv_nsec - self->start.tv_nsec) / 1000);
}

static void port_watchdog(void* ctx) {
  (void)ctx;
}

static void port_reboot(void* ctx) {
  ((device_t*)ctx)->is_reboot_asked = true;
}

static void power_off(void* ctx) {
  (void)ctx;
  _exit(EXIT_POWER_CUT);
}

/* ---- start ---- */

__attribute__((noreturn)) static void usage(const char* what, const char* value) {
  fprintf(stderr, "imucal: %s '%s'; see --help\n", what, value);
  exit(EXIT_USAGE_ERROR);
}

static uint32_t whole_number(const char* option, const char* text, char** end) {
  errno = 0;
  const unsigned long value = strtoul(text, end, 10);
  if (*end == text || errno || value > 0xFFFFFFFEu || text[0] == '-') usage(option, text);
  return (uint32_t)value;
}

static void set_cut(const char* text) {
  char* end;
  device.nor.cut_operation = whole_number("--cut", text, &end);
  device.nor.cut_byte = *end == ':' ? whole_number("--cut", end + 1, &end) : 0;
  if (*end) usage("--cut", text);
}

typedef struct {
  const char *serial, *feed, *flash, *bus;
  bool is_live;
} options_t;

enum {
  OPT_SERIAL = 1,
  OPT_LINK,
  OPT_FEED,
  OPT_FLASH,
  OPT_CUT,
  OPT_DELAY,
  OPT_LIVE,
  OPT_HELP,
  OPT_SENSOR,
  OPT_BUS,
  OPT_BOARD
};

static const struct option kOptions[] = {{"serial", required_argument, NULL, OPT_SERIAL},
                                         {"link", required_argument, NULL, OPT_LINK},
                                         {"feed", required_argument, NULL, OPT_FEED},
                                         {"flash", required_argument, NULL, OPT_FLASH},
                                         {"cut", required_argument, NULL, OPT_CUT},
                                         {"flash-delay-us", required_argument, NULL, OPT_DELAY},
                                         {"live", no_argument, NULL, OPT_LIVE},
                                         {"sensor", required_argument, NULL, OPT_SENSOR},
                                         {"bus", required_argument, NULL, OPT_BUS},
                                         {"help", no_argument, NULL, OPT_HELP},
                                         {"serial-number", required_argument, NULL, OPT_BOARD},
                                         {"channels", required_argument, NULL, OPT_BOARD},
                                         {"names", required_argument, NULL, OPT_BOARD},
                                         {"scale", required_argument, NULL, OPT_BOARD},
                                         {"full-scale", required_argument, NULL, OPT_BOARD},
                                         {"temp-scale", required_argument, NULL, OPT_BOARD},
                                         {"temp-zero", required_argument, NULL, OPT_BOARD},
                                         {"rate", required_argument, NULL, OPT_BOARD},
                                         {NULL, 0, NULL, 0}};

static void set_board(const char* option, const char* value) {
  const char* name = strcmp(option, "serial-number") ? option : "serial";
  if (!board_options_set(&board, name, value)) {
    fprintf(stderr, "imucal: --%s cannot be '%s'; see --help\n", option, value);
    exit(EXIT_USAGE_ERROR);
  }
}

static options_t read_options(int argc, char** argv) {
  options_t options = {.serial = "pty"};
  int index = 0;
  char* end;
  for (int code; (code = getopt_long(argc, argv, "", kOptions, &index)) != -1;) switch (code) {
    case OPT_SERIAL:
      options.serial = optarg;
      break;
    case OPT_LINK:
      device.link_path = optarg;
      break;
    case OPT_FEED:
      options.feed = optarg;
      break;
    case OPT_FLASH:
      options.flash = optarg;
      break;
    case OPT_CUT:
      set_cut(optarg);
      break;
    case OPT_DELAY:
      device.flash_delay_us = whole_number("--flash-delay-us", optarg, &end);
      break;
    case OPT_LIVE:
      options.is_live = true;
      break;
    case OPT_SENSOR:
      if (!bus_sensor_choose(&device.sensor, optarg, &board)) usage("--sensor", optarg);
      break;
    case OPT_BUS:
      options.bus = optarg;
      break;
    case OPT_BOARD:
      set_board(kOptions[index].name, optarg);
      break;
    case OPT_HELP:
      fputs(kHelp, stdout);
      exit(0);
    default:
      exit(EXIT_USAGE_ERROR);
    }
  if (optind < argc) usage("unexpected argument", argv[optind]);
  if (!options.bus != !device.sensor.kind)
    usage("--sensor and --bus go together:", options.bus ? options.bus : "no --bus");
  const imucal_status status = imucal_board_check(&board);
  if (status == IMUCAL_OK) return options;
  fprintf(stderr, "imucal: this board cannot be: %s; see --help\n", imucal_status_text(status));
  exit(EXIT_USAGE_ERROR);
}

static void open_all(const options_t* options) {
  char error[256];
  if (!nor_file_open(&device.nor, options->flash, IMUCAL_STORE_SLOTS * SLOT_BYTES, error, sizeof error) ||
      !serial_open(&device.serial, options->serial, error, sizeof error)) {
    fprintf(stderr, "imucal: %s\n", error);
    exit(EXIT_USAGE_ERROR);
  }
  feed_init(&device.feed, options->feed);
  bus_pipe_init(&device.sensor, options->bus);
  device.samples = (sample_stream_t){.ctx = &device.feed,
                                     .refill = feed_refill,
                                     .buffer = device.sample_bytes,
                                     .capacity = sizeof device.sample_bytes};
  if (device.link_path) {
    unlink(device.link_path);
    if (symlink(device.serial.name, device.link_path)) {
      fprintf(stderr, "imucal: --link %s: %s\n", device.link_path, strerror(errno));
      exit(EXIT_USAGE_ERROR);
    }
  }
  printf("serial %s\n", device.serial.name);
  fflush(stdout);
}

static void fill_port(imucal_port_t* port, bool is_live) {
  *port = (imucal_port_t){.ctx = &device,
                          .serial_read = port_serial_read,
                          .serial_write = port_serial_write,
                          .sample_read = port_sample_read,
                          .sample_enable = port_sample_enable,
                          .flash = {.erase = port_flash_erase,
                                    .program = port_flash_program,
                                    .read = port_flash_read,
                                    .ctx = &device,
                                    .slot_bytes = SLOT_BYTES,
                                    .erase_bytes = PAGE_BYTES,
                                    .program_bytes = 4},
                          .time_us = port_time_us,
                          .watchdog = port_watchdog,
                          .reboot = port_reboot,
                          .is_replay = !is_live,
                          .device = "posix"};
  if (device.sensor.kind) {
    port->sample_read = port_bus_read;
    port->sample_enable = port_bus_enable;
    port->sensor_report = port_bus_report;
  }
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  port->boot_id = (uint32_t)now.tv_nsec ^ (uint32_t)now.tv_sec << 12 ^ (uint32_t)getpid() << 20;
}

/* Until a byte comes; where samples are wanted, no longer than a moment: the feed may be a pipe without a
 * writer, which cannot be waited for. */
static void wait_for_work(bool is_sampling) {
  struct pollfd fds[2] = {{.fd = serial_poll_fd(&device.serial), .events = POLLIN},
                          {.fd = is_sampling && device.feed.has_delivered ? device.feed.fd : -1, .events = POLLIN}};
  if (app.tx_at != app.tx_end && device.serial.line_fd >= 0) {
    fds[0].events |= POLLOUT;
    if (is_sampling) fds[1].fd = -1; /* waiting for room, not for samples */
  }
  poll(fds, 2, is_sampling && !device.feed.has_delivered ? 2 : 20);
}

int main(int argc, char** argv) {
  signal(SIGPIPE, SIG_IGN);
  board_options_default(&board);
  device.nor = (nor_t){.power_off = power_off,
                       .size_bytes = IMUCAL_STORE_SLOTS * SLOT_BYTES,
                       .page_bytes = PAGE_BYTES,
                       .word_bytes = 4,
                       .cut_operation = NOR_NEVER};
  const options_t options = read_options(argc, argv);
  open_all(&options);
  nor_power_on(&device.nor);
  imucal_port_t port;
  fill_port(&port, options.is_live);
  for (;; port.boot_id++) {
    clock_gettime(CLOCK_MONOTONIC, &device.start);
    device.is_reboot_asked = false;
    if (imucal_app_init(&app, &port, &board) != IMUCAL_OK) return EXIT_USAGE_ERROR;
    while (!device.is_reboot_asked)
      if (!imucal_app_step(&app)) wait_for_work(app.is_enabled);
  }
}
