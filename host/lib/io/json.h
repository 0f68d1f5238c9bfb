// SPDX-License-Identifier: MIT
// JSON by name: for headers that pass it on.  Whoever looks into it includes io/json_file.h, which takes the compiler a
// second and a half.
#pragma once
#include <memory>
#include <nlohmann/json_fwd.hpp>

namespace imucal {

using Json = nlohmann::ordered_json;
class JsonField;

// A value that is carried as it was written, unread.  Copies share it; nobody changes it.
class UnreadJson {
public:
  UnreadJson(); // an empty object
  explicit UnreadJson(const Json& value);

  const Json& json() const { return *value_; }

private:
  std::shared_ptr<const Json> value_;
};

} // namespace imucal
