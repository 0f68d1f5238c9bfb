// SPDX-License-Identifier: MIT
// Logs that are those of the others only after a mistake of the engineer is taken back: rates of the other sign, temperatures in
// another unit.
//
// The polynomial of the other logs is fitted to means over a minute.  A log is unlike them where it leaves three times what they
// leave themselves, and with one of these changes no more than they do.  No cause does that: a change from run to run is not the
// polynomial turned, nor its temperatures stretched by 1.8.  The logs have 20 degC and more in common then.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/logs/campaign.h"

namespace imucal {

// Why each run is unlike all others of its campaign ("has ..."); empty: it is not.  Three runs at least tell which one it is, of
// fewer all are empty.  Needs the smooth temperatures of the runs.
std::vector<std::string> unlike_others(const Campaign& campaign);
// The same of the runs of `other` against all those of `campaign`.
std::vector<std::string> unlike_those_of(const Campaign& campaign, const Campaign& other);

} // namespace imucal
