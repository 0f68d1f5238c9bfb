// SPDX-License-Identifier: MIT
/* Purpose: the sensor's bus of the posix device as two named pipes, PREFIX.request and PREFIX.answer (port/sim/bus_sensor.h).
 * Opened when the first byte is sent; then a read waits for the model. */
#ifndef IMUCAL_PORT_BUS_PIPE_H
#define IMUCAL_PORT_BUS_PIPE_H
#include "port/sim/bus_sensor.h"

/* Sets send, receive and ctx of *sensor; prefix must stay. */
void bus_pipe_init(bus_sensor_t* sensor, const char* prefix);
#endif
