// SPDX-License-Identifier: MIT
// Text for people on a terminal: no line is wider than it.
#pragma once
#include <string>

namespace imucal {

// Lines of more than `columns` characters are broken at blanks; what follows is indented to the text behind the label with
// which the line begins ("  where   at ..."), two blanks further than the line where it has none.  Rows of a table (three and
// more runs of blanks inside) and words that are too long stay whole.  columns 0: the text as it is.
std::string wrapped(const std::string& text, int columns);

// Of the terminal behind a file descriptor, 80 where it does not say.  0: no terminal (a file, a pipe).
int terminal_columns(int fd);

} // namespace imucal
