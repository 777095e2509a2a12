// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/units.hpp"

#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace rangecal::app {

Unit fit_unit(const std::string& name, const std::string& place, const FleetJob& job) {
  Unit unit;
  unit.name = name;
  unit.fingerprint = {stamp_of(place), contents_of(place)};  // before the reading: a change meanwhile is one
  try {
    const Recording recording = load_recording(place);
    if (recording.kind == RecordingKind::pairs) {
      PairsOptions options;
      options.order = job.order;
      options.law = job.law;
      unit.calibration = full_pairs(make_pairs_problem({&recording, 1}), options).calibration;
      unit.misfit = unit_misfit(recording, unit.calibration);
    } else {
      CalibrateOptions options;
      options.methods = {Method::marginal};
      options.order = job.order;
      options.noise = job.law;
      unit.calibration = calibrate({&recording, 1}, options).front();
    }
    unit.summary = summarise(unit.calibration);
    if (unit.calibration.order() != job.order ||
        unit.calibration.counts.used < readings_for_own_fit(job.order))
      unit.summary.reset();
  } catch (const InputError& error) {
    unit.calibration.outcome = Outcome::failed;
    unit.calibration.reason = error.what();
    unit.calibration.counts = {};
  }
  return unit;
}

void write_csv(Database& database, const std::string& path) {
  Statement rows = database.prepare(
      "SELECT u.name, u.kind, u.outcome, u.reason, u.readings, u.used, p.* FROM units u LEFT JOIN posteriors p USING(name) ORDER BY u.name");
  std::string text;
  for (int c = 0; c < rows.columns(); ++c)
    if (c != 6) text += (c ? "," : "") + rows.name(c);
  text += "\n";
  while (rows.step()) {
    for (int c = 0; c < rows.columns(); ++c)
      if (c != 6) text += (c ? "," : "") + csv_label(rows.text(c));
    text += "\n";
  }
  write_file(path, text);
}

}  // namespace rangecal::app
