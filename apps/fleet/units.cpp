// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/units.hpp"

#include <fmt/format.h>

#include <new>
#include <nlohmann/json.hpp>

#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace rangecal::app {

namespace {

/// `full` with the noise shape asked for; of automatic the one that the readings show, Gaussian where it has no optimum.
Calibration fit_pairs(const PairsProblem& problem, PairsOptions options, NoiseShape asked) {
  const bool chooses = asked == NoiseShape::automatic;
  options.shape = chooses ? shape_of_pairs(problem, options) : asked;
  PairsFit fit = full_pairs(problem, options);
  if (chooses && options.shape != NoiseShape::gaussian && fit.calibration.outcome != Outcome::converged) {
    options.shape = NoiseShape::gaussian;
    fit = full_pairs(problem, options);
  }
  if (const auto shape = shape_estimate(fit.shape, fit.shape_std))
    fit.calibration.noise_shapes["range"] = *shape;
  return fit.calibration;
}

void read_and_fit(Unit& unit, const std::string& place, const FleetJob& job) {
  unit.fingerprint = {stamp_of(place), contents_of(place)};  // before the reading: a change meanwhile is one
  const Recording recording = load_recording(place);
  unit.notes = fmt::format("{}", fmt::join(recording.notes, "\n"));
  if (recording.kind == RecordingKind::pairs) {
    PairsOptions options;
    options.order = job.order;
    options.law = job.law;
    unit.calibration = fit_pairs(make_pairs_problem({&recording, 1}), options, job.noise_shape);
    unit.misfit = unit_misfit(recording, unit.calibration);
  } else {
    CalibrateOptions options;
    options.methods = {Method::marginal};
    options.noise_shape = job.noise_shape;
    options.order = job.order;
    options.noise = job.law;
    unit.calibration = calibrate({&recording, 1}, options).front();
  }
  unit.summary = summarise(unit.calibration);
  if (unit.calibration.order() != job.order || unit.calibration.counts.used < readings_for_own_fit(job.order))
    unit.summary.reset();
}

}  // namespace

std::string reason_of(const std::exception& error) {
  if (dynamic_cast<const InputError*>(&error)) return error.what();
  if (dynamic_cast<const std::bad_alloc*>(&error)) return "there is not enough memory for it";
  return std::string("internal error: ") + error.what();
}

Unit fit_unit(const std::string& name, const std::function<void(Unit&)>& fit) {
  Unit unit;
  unit.name = name;
  try {
    fit(unit);
  } catch (const std::exception& error) {
    const Fingerprint fingerprint = unit.fingerprint;
    unit = {};
    unit.name = name;
    unit.fingerprint = fingerprint;
    unit.calibration.outcome = Outcome::failed;
    unit.calibration.reason = reason_of(error);
  }
  return unit;
}

Unit fit_unit(const std::string& name, const std::string& place, const FleetJob& job) {
  return fit_unit(name, [&](Unit& unit) { read_and_fit(unit, place, job); });
}

std::string shape_to_json(const Calibration& calibration) {
  const auto found = calibration.noise_shapes.find("range");
  if (found == calibration.noise_shapes.end()) return "";
  nlohmann::ordered_json json{{"family", found->second.family}};
  for (const auto& [name, value] : found->second.parameters) json[name] = value;
  return json.dump();
}

NoiseShapeParameters shape_from_json(const std::string& text) {
  Calibration calibration;
  if (text.empty()) return {};
  try {
    const auto json = nlohmann::json::parse(text);
    ShapeEstimate& shape = calibration.noise_shapes["range"];
    shape.family = json.at("family");
    for (const auto& [name, value] : json.items())
      if (value.is_number()) shape.parameters[name] = value;
  } catch (const nlohmann::json::exception& error) {
    throw InputError("units.noise_shape: " + json_complaint(error));
  }
  return noise_shape_of(calibration, "range");
}

void write_csv(Database& database, const std::string& path) {
  Statement rows = database.prepare(
      "SELECT u.name, u.kind, u.outcome, u.reason, u.readings, u.used, p.*, u.notes FROM units u LEFT JOIN posteriors p USING(name) ORDER BY u.name");
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
