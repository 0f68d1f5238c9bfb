// SPDX-License-Identifier: MIT
// Reads a table of plain numbers: the text of a recorder's CSV, without its header.
//
// In: lines of n_columns fields, each a decimal number or missing ("", NaN, nan, null, NA), each line with its end (\n or
// \r\n).  Out: one array per column, of 64-bit integers where every field is a whole number that fits, else of doubles
// (each the nearest one; NaN where missing).  Nothing at all for any other text (quotes, blanks, comments, words, a row of
// another length, a column that is missing throughout): what reads all of CSV is then asked.
// Time O(bytes), in pieces side by side; memory: the columns.
#pragma once
#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "io/number.h"

namespace imucal {

struct NumberColumn {
  bool is_whole = true;               // 64-bit integers, else doubles
  std::unique_ptr<uint64_t[]> values; // their bits
};

struct NumberTable {
  size_t n_rows = 0;
  std::vector<NumberColumn> columns; // empty: the text is no table of plain numbers
};

class NumberTableReader {
public:
  NumberTableReader(const char* text, size_t size, char delimiter, size_t n_columns, int threads)
      : text_(text), size_(size), delimiter_(delimiter), is_whole_(n_columns, 1), threads_(threads) {}

  NumberTable read() {
    if (size_ == 0 || text_[size_ - 1] != '\n' || is_whole_.empty()) return {};
    cut();
    count_rows();
    // A column is taken for whole numbers until a field shows otherwise; then all is read anew.
    for (size_t k = 0; k <= is_whole_.size(); ++k) {
      NumberTable table = empty_table();
      const std::vector<size_t> real = fill(&table);
      if (has_failed_) return {};
      if (real.empty()) return table;
      for (const size_t column : real) is_whole_[column] = 0;
    }
    return {};
  }

private:
  static constexpr size_t kPieceBytes = size_t{1} << 20;
  static constexpr size_t kNone = static_cast<size_t>(-1);

  struct Piece {
    const char* begin = nullptr;
    const char* end = nullptr; // kNumberPadding bytes behind may be read
    size_t first_row = 0, n_rows = 0;
    std::vector<size_t> n_present = {};
  };

  // Pieces of whole lines; the last lines in a copy with room behind.
  void cut() {
    const char* const text_end = text_ + size_;
    const char* safe = size_ > 2 * kNumberPadding ? last_line_end(text_, text_end - kNumberPadding) : text_;
    const char* at = text_;
    while (at < safe) {
      const char* end = static_cast<size_t>(safe - at) <= kPieceBytes ? safe : last_line_end(at, at + kPieceBytes);
      if (end == at) end = safe; // one line longer than a piece: no table, and small work to find out
      pieces_.push_back({at, end});
      at = end;
    }
    tail_.assign(at, text_end);
    tail_.append(kNumberPadding, '\n');
    pieces_.push_back({tail_.data(), tail_.data() + (text_end - at)});
  }

  // Behind the last line end in front of `to`; `from` where there is none.
  static const char* last_line_end(const char* from, const char* to) {
    const void* last = memrchr(from, '\n', static_cast<size_t>(to - from));
    return last ? static_cast<const char*>(last) + 1 : from;
  }

  void each_piece(const std::function<void(Piece*)>& f) {
    parallel_for(static_cast<long>(pieces_.size()), threads_, [&](long i) { f(&pieces_[static_cast<size_t>(i)]); });
  }

  void count_rows() {
    each_piece([](Piece* p) { p->n_rows = static_cast<size_t>(std::count(p->begin, p->end, '\n')); });
    for (Piece& piece : pieces_) piece.first_row = n_rows_, n_rows_ += piece.n_rows;
  }

  NumberTable empty_table() const {
    NumberTable table{n_rows_, {}};
    for (const char whole : is_whole_)
      table.columns.push_back({whole != 0, std::unique_ptr<uint64_t[]>(new uint64_t[n_rows_])});
    return table;
  }

  // The columns that turned out not to be of whole numbers, after which nothing further was read.
  std::vector<size_t> fill(NumberTable* table) {
    std::vector<std::atomic<bool>> is_real(is_whole_.size());
    std::atomic<bool> stop{false};
    each_piece([&](Piece* piece) {
      piece->n_present.assign(is_whole_.size(), 0);
      const char* at = piece->begin;
      FieldEnds fields(delimiter_);
      for (size_t row = 0; row < piece->n_rows && !stop; ++row) {
        const size_t odd = take_row(&at, piece->first_row + row, &fields, table, piece);
        if (odd == kNone) continue;
        stop = true;
        if (odd < is_real.size())
          is_real[odd] = true;
        else
          has_failed_ = true;
      }
    });
    std::vector<size_t> found;
    for (size_t c = 0; c < is_real.size(); ++c)
      if (is_real[c]) found.push_back(c);
    if (found.empty() && !all_present()) has_failed_ = true;
    return found;
  }

  bool all_present() const {
    for (size_t c = 0; c < is_whole_.size(); ++c) {
      size_t n = 0;
      for (const Piece& piece : pieces_) n += piece.n_present[c];
      if (n == 0) return false;
    }
    return true;
  }

  // kNone; a column that holds no whole number; the number of columns for anything else.
  size_t take_row(const char** at, size_t row, FieldEnds* fields, NumberTable* table, Piece* piece) const {
    const size_t n = is_whole_.size();
    const char* p = *at;
    for (size_t c = 0; c < n; ++c) {
      if (c > 0 && *p++ != delimiter_) return n;
      const char* const begin = p;
      uint64_t bits = 0;
      if (is_whole_[c] && take_whole(&p, &bits) && at_end_of_field(p)) {
        ++piece->n_present[c];
      } else {
        p = begin;
        double value = 0;
        if (!take_real(&p, piece->end, fields, &value) || !at_end_of_field(p)) return n;
        if (is_whole_[c]) return c;
        piece->n_present[c] += !std::isnan(value);
        std::memcpy(&bits, &value, sizeof bits);
      }
      table->columns[c].values[row] = bits;
    }
    p += *p == '\r';
    if (*p != '\n') return n;
    *at = p + 1;
    return kNone;
  }

  bool at_end_of_field(const char* p) const { return *p == delimiter_ || *p == '\n' || (*p == '\r' && p[1] == '\n'); }

  static bool take_whole(const char** at, uint64_t* bits) {
    int64_t value = 0;
    const auto result = std::from_chars(*at, *at + 24, value);
    if (result.ec != std::errc()) return false;
    *at = result.ptr;
    std::memcpy(bits, &value, sizeof value);
    return true;
  }

  bool take_real(const char** at, const char* end, FieldEnds* fields, double* value) const {
    const char* const begin = *at;
    if (!is_number_start(begin[*begin == '-'])) { // neither "inf" nor "-nan"
      *value = std::numeric_limits<double>::quiet_NaN();
      return take_missing(at);
    }
    if (take_plain(at, fields, value)) return true;
    const auto result = std::from_chars(begin, end, *value);
    *at = result.ptr;
    return result.ec == std::errc();
  }

  static bool take_plain(const char** at, FieldEnds* fields, double* value) {
    Field field{};
    if (!fields->find(*at, &field)) return false;
    leave_carriage_return_out(&field);
    if (!plain_number(field, value)) return false;
    *at = field.end;
    return true;
  }

  static bool is_number_start(char c) { return (c >= '0' && c <= '9') || c == '.'; }

  bool take_missing(const char** at) const {
    for (const char* word : {"", "NaN", "nan", "null", "NA"}) {
      const size_t length = std::strlen(word);
      if (std::strncmp(*at, word, length) != 0 || !at_end_of_field(*at + length)) continue;
      *at += length;
      return true;
    }
    return false;
  }

  const char* text_;
  size_t size_;
  char delimiter_;
  std::vector<char> is_whole_; // of each column, as far as is known
  int threads_;
  std::string tail_;
  std::vector<Piece> pieces_;
  size_t n_rows_ = 0;
  std::atomic<bool> has_failed_{false};
};

} // namespace imucal
