// SPDX-License-Identifier: MIT
// The one place that knows processors: how inner loops get the widest vectors of the machine they run on.
//
// IMUCAL_WIDE before a function: compiled several times, the copy that fits is chosen when the program starts.
// Where the compiler or the system cannot do that it is compiled once, for the build's own target.
// Bits: lanes do not change the order of additions, and -ffp-contract=off (host.mk) keeps multiplications and
// additions apart, so that every copy gives the same bits.
#pragma once
#include <cstring>

// Dispatch needs the loader's indirect functions (glibc) and GCC: clang has no `optimize`.  The address
// sanitizer's run time is not yet up when the loader chooses.
#if defined(__GNUC__) && !defined(__clang__) && defined(__gnu_linux__) && defined(__x86_64__) &&                       \
    !defined(__SANITIZE_ADDRESS__)
#define IMUCAL_WIDE __attribute__((target_clones("avx512f", "avx2", "default"), optimize("O3")))
#else
#define IMUCAL_WIDE
#endif
// For what a function marked IMUCAL_WIDE calls: it must become part of each copy.
#define IMUCAL_WIDE_PART __attribute__((always_inline)) inline

namespace imucal {

// Four doubles side by side; two registers of two where the machine has no wider ones.
typedef double Lanes __attribute__((vector_size(32)));

// No alignment asked of the memory.
IMUCAL_WIDE_PART void load_lanes(Lanes* v, const double* from) {
  std::memcpy(v, from, sizeof *v);
}
IMUCAL_WIDE_PART void store_lanes(const Lanes& v, double* to) {
  std::memcpy(to, &v, sizeof v);
}

} // namespace imucal
