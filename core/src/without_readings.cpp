// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/without_readings.hpp"

#include "io/recording_parts.hpp"

namespace rangecal {

void leave_out_readings(const std::vector<char>& out, Recording& recording) {
  const auto from = [&](auto&... columns) { (io::leave_out(out, columns), ...); };
  Readings& r = recording.readings;
  Pairs& p = recording.pairs;
  if (recording.kind == RecordingKind::pairs)
    from(p.true_m, p.reading_m, p.batch, p.landmark, p.time_s, p.bearing_rad, p.row);
  else
    from(r.stop, r.landmark, r.repeat, r.time_s, r.range_m, r.bearing_rad, r.row);
  for (auto& [name, values] : recording.kind == RecordingKind::pairs ? p.covariates : r.covariates)
    from(values);
  from(recording.groups.of);
}

}  // namespace rangecal
