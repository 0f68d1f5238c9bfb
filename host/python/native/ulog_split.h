// SPDX-License-Identifier: MIT
// Splits a PX4 ULog: the data messages of some topics, which are nearly all of its bytes, go to one block for each message
// id; everything else, in its order, stays a small ULog that a parser of the whole format reads.  The first data message
// of each id stands in both, so that this parser judges topic, format and size.
// Source: PX4 user guide, "ULog file format": a header of 16 bytes, then messages of length (two bytes, little endian), type, content.
#pragma once
#include <cstdint>
#include <cstring>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace imucal {

struct UlogBlock {
  size_t record_bytes = 0; // of each message, without its id
  std::vector<uint8_t> bytes;
  bool is_wanted = false;
  bool has_first = false;
};

struct UlogSplit {
  bool is_simple = false; // false: nothing was split; read the file whole
  std::vector<uint8_t> rest;
  std::map<int, UlogBlock> blocks;
};

class UlogSplitter {
public:
  UlogSplitter(const uint8_t* data, size_t size, const std::vector<std::string>& topics)
      : data_(data), size_(size), topics_(topics.begin(), topics.end()) {}

  // Walks until the end or the first thing out of the ordinary: what follows that stays in the rest, as it is.
  UlogSplit split() {
    constexpr size_t kHeader = 16;
    if (size_ < kHeader) return {};
    out_.is_simple = true;
    size_t at = 0, copied = 0; // up to `copied` all is in the rest or in a block
    for (at = kHeader; at + 3 <= size_;) {
      const size_t length = data_[at] + 256u * data_[at + 1];
      const size_t end = at + 3 + length;
      if (end > size_) break;
      const What what = take(data_[at + 2], data_ + at + 3, length);
      if (what == What::kRefuse) return {};
      if (what == What::kStop) break;
      if (what == What::kDrop) {
        keep(copied, at);
        copied = end;
      }
      at = end;
    }
    keep(copied, size_);
    return std::move(out_);
  }

private:
  enum class What { kKeep, kDrop, kStop, kRefuse };

  void keep(size_t from, size_t to) { out_.rest.insert(out_.rest.end(), data_ + from, data_ + to); }

  What take(uint8_t type, const uint8_t* content, size_t length) {
    if (type == 'D') return take_data(content, length);
    if (type == 'A') return take_subscription(content, length);
    // Data appended after a crash stand at places that the flags name: not to be shifted.
    if (type == 'B') return length >= 16 && (content[8] & 1) == 0 ? What::kKeep : What::kRefuse;
    return std::strchr("FIMPQLCSO", type) && type != 0 ? What::kKeep : What::kStop;
  }

  What take_subscription(const uint8_t* content, size_t length) {
    if (length < 4) return What::kStop;
    const std::string name(reinterpret_cast<const char*>(content) + 3, length - 3);
    UlogBlock block;
    block.is_wanted = topics_.count(name) > 0;
    return out_.blocks.emplace(content[1] + 256 * content[2], std::move(block)).second ? What::kKeep : What::kRefuse;
  }

  What take_data(const uint8_t* content, size_t length) {
    if (length < 3) return What::kStop;
    const auto found = out_.blocks.find(content[0] + 256 * content[1]);
    if (found == out_.blocks.end()) return What::kStop;
    UlogBlock& block = found->second;
    const bool is_first = !block.has_first;
    if (is_first) block.has_first = true, block.record_bytes = length - 2;
    if (block.record_bytes != length - 2) return What::kStop;
    if (block.is_wanted) block.bytes.insert(block.bytes.end(), content + 2, content + length);
    return is_first ? What::kKeep : What::kDrop;
  }

  const uint8_t* data_;
  size_t size_;
  std::set<std::string> topics_;
  UlogSplit out_;
};

} // namespace imucal
