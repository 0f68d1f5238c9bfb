// SPDX-License-Identifier: MIT
/* The modelled MPU-6050 behind Wire, for native.cpp: the models are C. */
#pragma once
#include <stddef.h>
#include <stdint.h>
#ifdef __cplusplus
extern "C" {
#endif
/* is_there: false: nothing answers at 68h. */
void wire_model_power_on(int is_there);
/* One transaction at now_us; 0: acknowledged. */
int wire_model_transfer(double now_us, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in);
#ifdef __cplusplus
}
#endif
