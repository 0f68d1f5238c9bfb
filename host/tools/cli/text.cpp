// SPDX-License-Identifier: MIT
#include "cli/text.h"

#include "base/wrap.h"

namespace imucal {

void say(std::FILE* stream, const std::string& text) {
  std::fputs(wrapped(text, terminal_columns(::fileno(stream))).c_str(), stream);
}

} // namespace imucal
