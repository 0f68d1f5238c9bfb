// SPDX-License-Identifier: MIT
// What each subcommand of `calibrate` does with a connected device, and what it says.
#pragma once
#include <string>

#include "base/error.h"
#include "cli/program.h"
#include "device/device.h"
#include "device/run.h"

namespace imucal {

Exit list_ports(const CommonOptions& common);
Exit show_info(Device* device, const CommonOptions& common);

struct MonitorOptions {
  double duration_s = 0;                  // of sensor time; 0: until the sensor ends or Ctrl-C
  double stall_s = 0;                     // of a sensor that delivers nothing; 0: see device/watch.h
  std::string raw_path, compensated_path; // logs to write (record); both empty: print (monitor)
  bool may_overwrite = false;
};
Exit monitor(Device* device, const MonitorOptions& options, const CommonOptions& common);

Exit calibrate_device(Device* device, const RunOptions& options, const std::string& table_path,
                      const CommonOptions& common);

// data_error where the table is of another device or another sensor.
Exit flash_table(Device* device, const std::string& path, const CommonOptions& common);
Exit verify_table(Device* device, const std::string& path, const CommonOptions& common);
Exit dump_table(Device* device, const std::string& path, const CommonOptions& common);
Exit roll_back(Device* device, const CommonOptions& common);
// Ends a calibration, also one that another program left running; its filters are gone.
Exit stop_session(Device* device, const CommonOptions& common);
Exit erase_tables(Device* device, const CommonOptions& common);

// Results of `run` and `fit` (host/README.md): {"axes": [...]} of a table.
Json axes_json(const imucal_table_t& table);

} // namespace imucal
