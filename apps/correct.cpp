// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/effect_correction.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iostream>
#include <iterator>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>

#include "commands.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::app {
namespace {

/// A number that fills the text, spaces around it aside; nothing otherwise.
std::optional<double> number_of(std::string_view text) {
  const auto is_space = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    lines.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

/// Readings of one per line, or of the column reading_m or range_m; NaN where a field is empty.
std::vector<double> readings_from(const std::string& text, const std::string& name) {
  std::vector<double> readings;
  const std::vector<std::string_view> lines = lines_of(text);
  const auto blank = [](std::string_view line) {
    return line.find_first_not_of(" \t\r") == std::string_view::npos;
  };
  const auto first = std::find_if_not(lines.begin(), lines.end(), blank);
  if (first == lines.end()) throw InputError(name, 0, "", "holds no reading");
  if (number_of(*first)) {
    for (std::size_t i = 0; i < lines.size(); ++i) {
      if (blank(lines[i])) continue;
      const auto reading = number_of(lines[i]);
      if (!reading)
        throw InputError(name, static_cast<long>(i + 1), "",
                         "'" + std::string(lines[i]) + "' is not a number");
      readings.push_back(*reading);
    }
    return readings;
  }
  const CsvTable table = CsvTable::parse(text, name);
  auto column = table.find("reading_m");
  if (!column) column = table.find("range_m");
  if (!column)
    throw InputError(name, 1, "", "there is no column reading_m or range_m, and the first line is no number");
  for (std::size_t row = 0; row < table.rows(); ++row)
    readings.push_back(table.number(row, *column).value_or(std::nan("")));
  return readings;
}

std::string why_unusable(double reading) {
  if (std::isnan(reading)) return "missing";
  if (!std::isfinite(reading)) return "not_finite";
  return reading == 0.0 ? "zero" : reading < 0.0 ? "negative" : "";
}

void print_root(double reading, const CorrectionRoot& root, int candidate, std::string flags) {
  const auto add = [&](const char* flag) { flags += (flags.empty() ? "" : "+") + std::string(flag); };
  if (root.extrapolated && flags != "out_of_range") add("extrapolated");
  if (root.turning_point) add("turning_point");
  const std::optional<double> std_dev = root.std_dev_total_m ? root.std_dev_total_m : root.std_dev_m;
  fmt::print("{},{:.6f},{},{},{}\n", reading, root.distance_m, std_dev ? fmt::format("{:.6f}", *std_dev) : "",
             candidate, flags.empty() ? "ok" : flags);
}

void print_correction(const EffectCorrector& corrector, double reading, const ReadingSetting& setting, bool maximum_likelihood) {
  if (const std::string why = why_unusable(reading); !why.empty()) {
    fmt::print("{},,,,{}\n", std::isnan(reading) ? "" : fmt::format("{}", reading), why);
    return;
  }
  const Correction found = corrector.correct(reading, setting);
  std::vector<CorrectionRoot> roots = maximum_likelihood ? found.maximum_likelihood : found.least_squares;
  std::sort(roots.begin(), roots.end(), [](const CorrectionRoot& a, const CorrectionRoot& b) {
    return a.log_likelihood > b.log_likelihood;
  });
  if (roots.empty()) {
    if (found.nearest)
      print_root(reading, *found.nearest, 1, "out_of_range");
    else
      fmt::print("{},,,,out_of_range\n", reading);
    return;
  }
  for (std::size_t i = 0; i < roots.size(); ++i)
    print_root(reading, roots[i], static_cast<int>(i + 1), roots.size() > 1 ? "ambiguous" : "");
}

/// The effects of a calibration and what they need to know about each reading.
struct Settings {
  EffectCorrector corrector;
  std::vector<ReadingSetting> of_reading;
};

/// Index of a label among the calibration's, -1 where it is not one of them.
template <typename Items>
int index_of(const Items& items, const std::string& label) {
  for (std::size_t i = 0; i < items.size(); ++i)
    if (items[i].label == label) return static_cast<int>(i);
  return -1;
}

Settings settings_from(const Calibration& calibration, const std::string& text, const std::string& name, std::size_t count) {
  if (calibration.effects.empty()) return {EffectCorrector(calibration, {}), std::vector<ReadingSetting>(count)};
  std::optional<CsvTable> table;
  const std::vector<std::string_view> lines = lines_of(text);
  if (!lines.empty() && !number_of(lines[0])) table = CsvTable::parse(text, name);
  std::vector<std::string> covariates;
  if (table)
    for (std::size_t c = 0; c < table->columns().size(); ++c)
      if (table->is_numeric(c)) covariates.push_back(table->columns()[c]);
  Settings settings{EffectCorrector(calibration, covariates), std::vector<ReadingSetting>(count)};
  const auto column = [&](const char* of) { return table ? table->find(of) : std::nullopt; };
  for (const EffectCorrector::Need& need : settings.corrector.needs()) {
    const bool by_stop = need.column == "heading_rad" && column("stop") && !calibration.stops.empty();
    if (!column(need.column.c_str()) && !by_stop)
      throw InputError(name, 1, need.column, "is missing: the calibration's effect " + need.effect + " needs it to be undone");
  }
  if (!table) return settings;
  double first_time = std::numeric_limits<double>::infinity();
  if (const auto time = column("time_s"))
    for (std::size_t row = 0; row < table->rows(); ++row) first_time = std::min(first_time, table->finite(row, *time));
  for (std::size_t row = 0; row < count; ++row) {
    ReadingSetting& at = settings.of_reading[row];
    const auto number = [&](const char* of, double& to) {
      if (const auto c = column(of)) to = table->number(row, *c).value_or(std::nan(""));
    };
    number("bearing_rad", at.bearing_rad);
    number("heading_rad", at.heading_rad);
    number("radius_m", at.radius_m);
    number("time_s", at.time_s);
    at.time_s -= first_time;
    if (const auto c = column("landmark")) at.landmark = index_of(calibration.landmarks, table->label(row, *c));
    if (const auto c = column("stop")) at.stop = index_of(calibration.stops, table->label(row, *c));
    if (at.stop >= 0 && !std::isfinite(at.heading_rad))
      at.heading_rad = calibration.stops[static_cast<std::size_t>(at.stop)].pose.heading_rad;
    if (const auto c = column("repeat")) at.repeat = static_cast<int>(table->number(row, *c).value_or(0.0));
    for (const std::string& covariate : covariates)
      at.covariates.push_back(table->number(row, *table->find(covariate)).value_or(std::nan("")));
  }
  return settings;
}

struct CorrectCommand {
  std::string calibration, file = "-", roots = "ls";

  int run() const {
    if (roots != "ls" && roots != "ml") throw InputError("--roots is '" + roots + "', not ls or ml");
    const Calibration loaded = load_calibration(calibration);
    const bool open_curve = loaded.outcome == Outcome::unobservable && !loaded.alpha_covariance;
    if (!is_usable(loaded.outcome) || open_curve)
      throw InputError(calibration + ": its outcome is " + to_string(loaded.outcome) +
                       ", so it cannot correct readings");
    if (loaded.outcome == Outcome::unobservable)
      fmt::print(stderr, "rangecal: warning: {}: {}\n", calibration, loaded.reason);
    const bool from_stdin = file == "-";
    const std::string text =
        from_stdin ? std::string(std::istreambuf_iterator<char>(std::cin), {}) : read_file(file);
    const std::vector<double> readings = readings_from(text, from_stdin ? "stdin" : file);
    const Settings settings = settings_from(loaded, text, from_stdin ? "stdin" : file, readings.size());
    fmt::print("reading_m,distance_m,std_m,candidate,flag\n");
    for (std::size_t i = 0; i < readings.size(); ++i)
      print_correction(settings.corrector, readings[i], settings.of_reading[i], roots == "ml");
    return done;
  }
};

}  // namespace

void add_correct(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("correct", "turn raw readings into distances with standard deviations");
  const auto state = std::make_shared<CorrectCommand>();
  command->add_option("CALIBRATION", state->calibration, "what 'calibrate --json' wrote")->required();
  command
      ->add_option("FILE", state->file,
                   "CSV with a column reading_m or range_m, or one reading per line; - or nothing: stdin")
      ->capture_default_str();
  command
      ->add_option(
          "--roots", state->roots,
          "ls: distances where f(d) is the reading; ml: the most likely distances (2016 paper, eq. 27)")
      ->capture_default_str();
  command->footer(
      "Prints CSV: reading_m, distance_m, std_m (noise of the reading and uncertainty of f together), "
      "candidate (1 is\n"
      "the most likely; every distance that explains the reading is listed), flag: ok, or ambiguous, "
      "extrapolated\n"
      "(outside the distances fitted), turning_point, out_of_range (nearest distance given), or why there is "
      "none:\n"
      "missing, zero, negative, not_finite.\n"
      "Effects that 'diagnose --calibration' left in CALIBRATION are undone; the CSV then has the columns they need\n"
      "(bearing_rad, time_s from its first reading on, landmark, stop, ...); a missing one is named.\n"
      "\n"
      "Examples:\n"
      "  rangecal correct cal.json readings.csv > distances.csv\n"
      "  echo 1.234 | rangecal correct cal.json");
  command->callback([state, &chosen] { chosen = [state] { return state->run(); }; });
}

}  // namespace rangecal::app
