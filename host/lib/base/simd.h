// SPDX-License-Identifier: MIT
// The one place that knows processors (x87.h apart): how inner loops get the widest vectors of the machine they run on.
//
// IMUCAL_WIDE before a function: compiled several times, the copy that fits is chosen when the program starts.
// Where the compiler or the system cannot do that it is compiled once, for the build's own target.
// Bits: lanes do not change the order of additions, and -ffp-contract=off (host.mk) keeps multiplications and
// additions apart, so that every copy gives the same bits.
#pragma once
#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

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

// For instructions that the vectors of the language have no word for (gathers): a function for AVX-512 beside a plain one
// of the same bits; has_avx512() chooses.  Inside such a function intrinsics may be used.
#if defined(__GNUC__) && defined(__x86_64__)
#define IMUCAL_AVX512 __attribute__((target("avx512f")))
#define IMUCAL_EIGHT IMUCAL_AVX512
#else
#define IMUCAL_EIGHT
#endif
// IMUCAL_BY_LANES(name, (double* x, size_t n), (x, n)) makes `name` of a template name_by<V>: with vectors of eight where the
// machine has them, with vectors of four elsewhere, which would take vectors of eight apart in memory.
#define IMUCAL_BY_LANES(name, parameters, arguments)                                                                   \
  IMUCAL_EIGHT void name##_8 parameters {                                                                              \
    name##_by<Lanes8> arguments;                                                                                       \
  }                                                                                                                    \
  IMUCAL_WIDE void name##_4 parameters {                                                                               \
    name##_by<Lanes> arguments;                                                                                        \
  }                                                                                                                    \
  inline void name parameters {                                                                                        \
    (has_avx512() ? name##_8 : name##_4) arguments;                                                                    \
  }

namespace imucal {

#if defined(IMUCAL_AVX512)
inline bool has_avx512() {
  return __builtin_cpu_supports("avx512f");
}
#else
inline bool has_avx512() {
  return false;
}
#endif

// Four doubles side by side; two registers of two where the machine has no wider ones.
typedef double Lanes __attribute__((vector_size(32)));
typedef double Lanes8 __attribute__((vector_size(64)));
typedef float Lanes8f __attribute__((vector_size(32)));

// No alignment asked of the memory.
template <class V> IMUCAL_WIDE_PART void load_lanes(V* v, const double* from) {
  std::memcpy(v, from, sizeof *v);
}
template <class V> IMUCAL_WIDE_PART void store_lanes(const V& v, double* to) {
  std::memcpy(to, &v, sizeof v);
}

// f(0), f(1), .. f(N - 1), written out: vectors in an array stay in registers where every index is known, and in memory where
// a loop counts.
template <size_t N, class F> IMUCAL_WIDE_PART void unrolled(const F& f) {
  if constexpr (N > 0) {
    unrolled<N - 1>(f);
    f(N - 1);
  }
}
// Behind the brackets of a lambda for it.
#define IMUCAL_UNROLLED(i) (const size_t i) __attribute__((always_inline))

// Bit i of the result: the i-th of eight bytes, the first the lowest, is zero.
inline uint32_t where_zero_8(uint64_t v) {
  constexpr uint64_t kLow = 0x7F7F7F7F7F7F7F7FULL;
  const uint64_t zeros = ~(((v & kLow) + kLow) | v | kLow) >> 7;
  return static_cast<uint32_t>((zeros * 0x0102040810204080ULL) >>
                               56); // bit 8 i goes to bit 56 + i, and nothing else there
}

inline uint32_t where_8(const char* at, char a, char b) {
  constexpr uint64_t kEach = 0x0101010101010101ULL;
  uint64_t v;
  std::memcpy(&v, at, sizeof v);
  if (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__) v = __builtin_bswap64(v);
  return where_zero_8(v ^ kEach * static_cast<unsigned char>(a)) |
         where_zero_8(v ^ kEach * static_cast<unsigned char>(b));
}

// The bytes among the 16 at `at` that are `a` or `b`: bit i of the result for the i-th.
inline uint32_t where_16(const char* at, char a, char b) {
#if defined(__SSE2__)
  __m128i bytes;
  std::memcpy(&bytes, at, sizeof bytes);
  const __m128i found = _mm_or_si128(_mm_cmpeq_epi8(bytes, _mm_set1_epi8(a)), _mm_cmpeq_epi8(bytes, _mm_set1_epi8(b)));
  return static_cast<uint32_t>(_mm_movemask_epi8(found));
#else
  return where_8(at, a, b) | where_8(at + 8, a, b) << 8;
#endif
}

} // namespace imucal
