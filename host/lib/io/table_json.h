// SPDX-License-Identifier: MIT
// The calibration table as JSON (host/formats.md, Table), field for field the binary of common/table.h:
//   { "imucal_table": 1, "serial": "…", "sequence": 3, "created": "2026-11-21T06:22:00Z",
//     "degc_per_count": …, "degc_at_zero": …,
//     "axes": [ { "axis": "gx_dph", "order": 3, "t0_degc": …, "range_degc": …, "coeff_dph": [b0 … bM],
//                 "scale_coeff": [m0 …], "span_degc": [lo, hi], "temp_degc": [9 temperatures], "sigma_dph":
//                 [9], "model": {"arw_deg_rt_h": …, "markov": [{"sigma_dph": …, "tau_s": …}]},
//                 "dph_per_count": …, "full_scale_counts": …, "n_seconds": … } ] }
// An axis that was made although rules spoke against it (--accept) also has "accepted": [their names] and "error_factor": how
// many times sigma is too small by what was seen, 1 or more (TableNote).  The binary has no room for them.
// A channel in mg (ax_mg) has coeff_mg, sigma_mg, mg_per_count.  Numbers are written with the fewest digits
// that give the same float32 back, so that JSON -> binary -> JSON changes nothing.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "io/json.h"
#include "table.h"

namespace imucal {

// The unit in a channel's name: "dph", "mg", …
std::string channel_unit(const imucal_table_channel_t& channel);

// What was accepted of an axis when its table was made.
struct TableNote {
  std::string axis;
  std::vector<std::string> accepted;
  double error_factor = 1; // sigma is so many times too small by what was seen, 1..1e6
};

Json to_json(const imucal_table_t& table, const std::vector<TableNote>& notes = {});

// data_error names file and field: unknown version, missing or unknown field, text where a number belongs, a
// value that imucal_table_validate refuses.
imucal_table_t table_from_json(const JsonField& field);
imucal_table_t read_table(const std::string& path); // JSON, or the binary where the name ends in .bin
// The notes of its axes, none of a binary; data_error as table_from_json.
std::vector<TableNote> read_table_notes(const std::string& path);

// The binary, checked.  `place` (file, port) is named in the data_error.
std::vector<uint8_t> table_bytes(const imucal_table_t& table, const std::string& place);
imucal_table_t table_from_bytes(const std::vector<uint8_t>& bytes, const std::string& place);

// JSON, or the binary where the name ends in .bin (without the notes).
void write_table(const std::string& path, const imucal_table_t& table, const std::vector<TableNote>& notes = {});

// One line per field that differs ("gx_dph coeff_dph[2]: 12.5 against 12.25"); sequence number and creation
// time are left out: they say when a table was flashed, not what it holds.
std::vector<std::string> table_differences(const imucal_table_t& left, const imucal_table_t& right);

// A float as the double with the fewest decimal digits that rounds to it.
double shortest(float value);

} // namespace imucal
