// SPDX-License-Identifier: MIT
/* Purpose: the sensor's bus of an emulated device as two named pipes of QEMU's host: arguments sensor=NAME bus=PREFIX; the
 * pipes are PREFIX.request and PREFIX.answer (port/sim/bus_sensor.h, tests/emu/sensor_server.c). */
#ifndef IMUCAL_PORT_SEMIHOST_BUS_H
#define IMUCAL_PORT_SEMIHOST_BUS_H
#include "port/sim/bus_sensor.h"

/* Chooses the sensor by the arguments and fills *board; false: there is no argument sensor=.  A name that is not known ends the
 * emulation with status 2.  Pipes are opened when samples are first wanted. */
bool semihost_bus_sensor(bus_sensor_t* sensor, const char* command_line, imucal_board_t* board);

/* The callbacks of imucal_port_t, for a port whose ctx is the bus_sensor_t. */
imucal_port_sample_t semihost_bus_read(void* ctx, imucal_sample_t* sample);
void semihost_bus_enable(void* ctx, bool is_wanted);
void semihost_bus_report(void* ctx, imucal_link_sensor_reply_t* report);
#endif
