// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/candidates.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iostream>
#include <iterator>
#include <memory>
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

void print_correction(double reading, const std::vector<CorrectionCandidate>& candidates) {
  const auto field = [](const std::optional<double>& value) { return value ? fmt::format("{:.6f}", *value) : ""; };
  for (const CorrectionCandidate& c : candidates)
    fmt::print("{},{},{},{},{}\n", std::isnan(reading) ? "" : fmt::format("{}", reading), field(c.distance_m),
               field(c.std_dev_m), c.distance_m ? fmt::format("{}", c.candidate) : "", c.flag);
}

/// The readings as a table where the text is one; nothing where it is one number per line.
std::optional<CsvTable> table_from(const std::string& text, const std::string& name) {
  const std::vector<std::string_view> lines = lines_of(text);
  if (lines.empty() || number_of(lines[0])) return std::nullopt;
  return CsvTable::parse(text, name);
}

struct CorrectCommand {
  std::string calibration, file = "-", roots = "ls";

  int run() const {
    if (roots != "ls" && roots != "ml") throw InputError("--roots is '" + roots + "', not ls or ml");
    const Calibration loaded = load_calibration(calibration);
    require_curve(loaded, calibration);
    if (loaded.outcome == Outcome::unobservable)
      fmt::print(stderr, "rangecal: warning: {}: {}\n", calibration, loaded.reason);
    const bool from_stdin = file == "-";
    const std::string text =
        from_stdin ? std::string(std::istreambuf_iterator<char>(std::cin), {}) : read_file(file);
    const std::string name = from_stdin ? "stdin" : file;
    const std::vector<double> readings = readings_from(text, name);
    const std::optional<CsvTable> table = table_from(text, name);
    const ReadingSettings settings = reading_settings(loaded, table ? &*table : nullptr, name, readings.size());
    fmt::print("reading_m,distance_m,std_m,candidate,flag\n");
    for (std::size_t i = 0; i < readings.size(); ++i)
      print_correction(readings[i], correction_candidates(settings.corrector, readings[i], settings.of_reading[i],
                                                          roots == "ml"));
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
