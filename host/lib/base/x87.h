// SPDX-License-Identifier: MIT
// Libraries on 32-bit x86.  Distributions compile them for the old coprocessor, whose registers hold more digits than a
// double, so that a value changes when it is stored.  With them NLopt's BOBYQA was seen never to end (Debian's libnlopt0,
// i386).  While a RoundsToDouble lives, the coprocessor of this thread rounds as every other machine does.
// Nothing on other processors.  Our own code uses SSE2 there (tests/portable/host.mk).
#pragma once
#if defined(__i386__) && defined(__GLIBC__)
#include <fpu_control.h>
#endif

namespace imucal {

class RoundsToDouble {
public:
  RoundsToDouble(const RoundsToDouble&) = delete;
  RoundsToDouble& operator=(const RoundsToDouble&) = delete;
#if defined(__i386__) && defined(__GLIBC__)
  RoundsToDouble() {
    _FPU_GETCW(before_);
    fpu_control_t to_double = static_cast<fpu_control_t>((before_ & ~_FPU_EXTENDED) | _FPU_DOUBLE);
    _FPU_SETCW(to_double);
  }
  ~RoundsToDouble() {
    _FPU_SETCW(before_);
  }

private:
  fpu_control_t before_;
#else
  RoundsToDouble() {}
  ~RoundsToDouble() {}
#endif
};

} // namespace imucal
