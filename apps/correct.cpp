// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>

#include "commands.hpp"
#include "ingest/bags/bag_correction.hpp"
#include "ingest/bags/message_source.hpp"
#include "ingest/csv.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/utf8.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/solvers/correction/candidates.hpp"
#include "rangecal/solvers/correction/posterior.hpp"
#include "read_progress.hpp"
#include "track/line_source.hpp"

namespace rangecal::app {
namespace {

constexpr double fastest = 3e8, farthest = 1e12;  ///< [m/s], [m]
constexpr std::size_t most_bytes = std::size_t{256} << 20;

std::string text_of_stdin() {
  std::string text(1 << 16, '\0');
  std::size_t size = 0;
  while (const std::size_t count = std::fread(text.data() + size, 1, text.size() - size, stdin)) {
    size += count;
    if (size > most_bytes)
      throw InputError("stdin", 0, "", "is larger than 256 MB; 'rangecal track' takes any stream");
    if (size == text.size()) text.resize(2 * size);
  }
  text.resize(size);
  return text;
}

/// The lines of a text.
class TextLines {
 public:
  explicit TextLines(std::string_view text) : rest_(text) {}
  bool next(std::string_view& line) {
    if (rest_.empty()) return false;
    const std::size_t end = std::min(rest_.find('\n'), rest_.size());
    line = rest_.substr(0, end);
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    ++number_;
    return true;
  }
  long number() const { return number_; }

 private:
  std::string_view rest_;
  long number_ = 0;
};

bool blank(std::string_view line) { return line.find_first_not_of(" \t\r") == std::string_view::npos; }

/// Readings of one per line, or of the column reading_m or range_m; NaN where a field is empty.
std::vector<double> readings_from(const std::string& text, const std::string& name) {
  std::vector<double> readings;
  TextLines lines(text);
  std::string_view line;
  while (lines.next(line) && blank(line)) {
  }
  if (blank(line)) throw InputError(name, 0, "", "holds no reading");
  if (number_of(line)) {
    do {
      if (blank(line)) continue;
      const auto reading = number_of(line);
      if (!reading)
        throw InputError(name, lines.number(), "",
                         "'" + std::string(line.substr(0, 40)) + "' is not a number");
      readings.push_back(*reading);
    } while (lines.next(line));
    return readings;
  }
  CsvRows rows = CsvRows::parse(text, name);
  auto column = rows.find("reading_m");
  if (!column) column = rows.find("range_m");
  if (!column)
    throw InputError(
        name, 1, "",
        "there is no column reading_m or range_m, and the first line is no number: say --reading COLUMN, "
        "and with --unit, --landmark, --time, ... what you said to 'rangecal import csv'");
  while (rows.next()) readings.push_back(rows.number(*column).value_or(std::nan("")));
  return readings;
}

std::string what_lies_beyond(const ColumnBeyond& column, const Calibration& calibration) {
  if (!column.label.empty())
    return fmt::format(
        "are of a landmark or device that the calibration does not know, first '{}' in row {}; it knows {}: "
        "extrapolated_column",
        column.label, column.first_row, fmt::join(labels_of_landmarks(calibration), ", "));
  return fmt::format(
      "have a {} outside the {:.6g} to {:.6g} over which the effects that use it were fitted, first in row {}: "
      "extrapolated_column",
      column.column, column.from, column.to, column.first_row);
}

/// Readings that lie beyond what the calibration was fitted over, for stderr.
class Beyond {
 public:
  Beyond() = default;
  explicit Beyond(const ingest::BagCorrected& bag)
      : readings_(bag.readings - bag.kept),
        extrapolated_(bag.extrapolated),
        out_of_range_(bag.out_of_range) {}

  /// By the flag of the most likely distance.
  void count(const std::string& flag) {
    ++readings_;
    // the parts of a flag are whole words between "+"
    for (std::size_t at = 0; at <= flag.size(); at = std::min(flag.find('+', at), flag.size()) + 1) {
      const std::string_view part = std::string_view(flag).substr(at, flag.find('+', at) - at);
      extrapolated_ += part == "extrapolated";
      out_of_range_ += part == "out_of_range";
    }
  }
  void say(const Calibration& calibration, const std::vector<ColumnBeyond>& columns) const {
    const auto line = [&](std::size_t count, const std::string& what) {
      if (count > 0) fmt::print(stderr, "rangecal: {} of {} readings {}\n", count, readings_, what);
    };
    line(extrapolated_,
         fmt::format("are flagged extrapolated: at distances outside the {:.4g} to {:.4g} m of the fit",
                     calibration.range_min_m, calibration.range_max_m));
    line(out_of_range_, "are flagged out_of_range: read at no distance of the fit, nor near its ends");
    for (const ColumnBeyond& column : columns)  // also of readings without a distance
      line(column.readings, what_lies_beyond(column, calibration));
  }

 private:
  std::size_t readings_ = 0, extrapolated_ = 0, out_of_range_ = 0;
};

/// What is printed: a line for each distance of a reading; or, of a table that is kept, its own lines, each followed by the most likely
/// distance, in the table's own separator and decimal sign.
class AnswerLines {
 public:
  /// `more`: columns that follow the flag, each with a comma before it.
  AnswerLines(const ingest::ReadingsTable* kept, const std::string& more) : kept_(kept) {
    if (!kept) {
      fmt::print("reading_m,distance_m,std_m,candidate,flag{}\n", more);
      return;
    }
    std::string head = kept->lines.front();
    const std::string names = "distance_m,std_m,flag" + more + ",";
    for (std::size_t at = 0; at < names.size(); at = names.find(',', at) + 1) {
      const std::string name = names.substr(at, names.find(',', at) - at);
      const bool taken = std::find(kept->columns.begin(), kept->columns.end(), name) != kept->columns.end();
      head += kept->separator + name + (taken ? "_corrected" : "");
    }
    fmt::print("{}\n", head);
  }

  /// The distances of one reading follow each other, the most likely first. `distance_and_std`: with a comma between.
  void print(std::size_t row, double reading, std::string_view distance_and_std, std::string_view candidate,
             std::string_view flag, std::string_view more = "") {
    if (!kept_) {
      fmt::print("{},{},{},{}{}\n", std::isnan(reading) ? "" : fmt::format("{}", reading), distance_and_std,
                 candidate, flag, more);
      return;
    }
    if (row < printed_) return;
    printed_ = row + 1;
    std::string answer = fmt::format(",{},{}{}", distance_and_std, flag, more);
    const bool commas = kept_->decimal_commas && kept_->separator != ',';
    for (char& c : answer) {
      if (c == ',')
        c = kept_->separator;
      else if (c == '.' && commas)
        c = ',';
    }
    fmt::print("{}{}\n", kept_->lines[row + 1], answer);
  }

 private:
  const ingest::ReadingsTable* kept_;
  std::size_t printed_ = 0;  ///< rows of the table so far
};

void print_correction(AnswerLines& lines, std::size_t row, double reading,
                      const std::vector<CorrectionCandidate>& candidates) {
  const auto field = [](const std::optional<double>& value) {
    return value ? fmt::format("{:.6f}", *value) : "";
  };
  for (const CorrectionCandidate& c : candidates)
    lines.print(row, reading, field(c.distance_m) + "," + field(c.std_dev_m),
                c.distance_m ? fmt::format("{}", c.candidate) : "", c.flag);
}

/// The readings as a table where the text is one; nothing where it is one number per line.
std::optional<CsvTable> table_from(const std::string& text, const std::string& name) {
  if (number_of(std::string_view(text).substr(0, text.find('\n')))) return std::nullopt;
  return CsvTable::parse(text, name);
}

/// Posteriors of readings that follow each other, under a prior that may follow from the one before.
class Posteriors {
 public:
  static constexpr const char* columns =
      ",probability,mode_m,mean_m,low95_m,high95_m";  ///< beside those of every answer

  Posteriors(const ReadingSettings& settings, const std::string& kind, const std::vector<double>& limits,
             double speed, const CsvTable* table, const std::string& name)
      : settings_(settings), table_(table), speed_(speed) {
    if (kind != "uniform" && kind != "map" && kind != "motion")
      throw InputError("--prior is '" + kind + "', not uniform, map or motion");
    if (!limits.empty()) {
      base_.low_m = limits[0];
      base_.high_m = limits[1];
    }
    base_.check();
    const auto column = [&](const char* of) {
      const auto found = table ? table->find(of) : std::nullopt;
      if (!found) throw InputError(name, 1, of, "is missing: --prior " + kind + " needs it");
      return *found;
    };
    if (kind == "map") map_ = {column("prior_m"), column("prior_sigma_m")};
    if (kind == "motion") {
      if (!(speed > 0.0))
        throw InputError("--prior motion needs --speed, the largest speed along the beam in m/s");
      if (!(speed < fastest)) throw InputError(fmt::format("--speed {:g} is no speed in m/s", speed));
      time_ = column("time_s");
    }
  }

  /// One prior for so many readings that a table is made sooner than they are integrated, if there is a table.
  void expect(std::size_t readings) {
    constexpr std::size_t many = 20000;
    const Calibration& calibration = settings_.corrector.calibration();
    if (map_ || time_ || readings < many || !calibration.effects.empty()) return;
    try {
      fast_ = std::make_unique<const PosteriorTable>(calibration, base_);
    } catch (const InputError&) {  // a curve with more parts than a table takes: integrals serve
    }
  }

  /// What a row says of its prior: a bad one stops the command before it prints any.
  void check(std::size_t i) const {
    if (map_) prior_of(i);
    if (time_ && table_->finite(i, *time_) < (i > 0 ? table_->finite(i - 1, *time_) : -HUGE_VAL))
      table_->fail(i, *time_, "is earlier than the row before");
  }

  const Beyond& beyond() const { return beyond_; }

  void print(AnswerLines& lines, std::size_t i, double reading) {
    DistancePrior prior = map_ ? prior_of(i) : base_;
    double time = 0.0;
    if (time_) {
      time = table_->finite(i, *time_);
      if (before_) prior = moved(*before_, base_, std::min(farthest, speed_ * (time - last_time_)));
    }
    if (!(reading > 0.0) || !std::isfinite(reading) || !settings_.of_reading[i].complete) {
      const CorrectionCandidate why =
          correction_candidates(settings_.corrector, reading, settings_.of_reading[i], false).front();
      lines.print(i, reading, ",", "", why.flag, ",,,,,");
      beyond_.count(why.flag);
      return;
    }
    if (fast_ && reading >= fast_->low_reading_m() && reading <= fast_->high_reading_m()) {
      print(lines, i, reading, (*fast_)(reading));
      return;
    }
    const DistancePosterior posterior =
        distance_posterior(settings_.corrector, reading, settings_.of_reading[i], prior);
    if (posterior.outcome != Outcome::converged) {
      lines.print(i, reading, ",", "", "out_of_range", ",,,,,");
      beyond_.count("out_of_range");
      return;
    }
    if (time_) {
      before_ = posterior;
      last_time_ = time;
    }
    std::vector<PosteriorRoot> roots = posterior.roots;
    print(lines, i, reading, std::move(roots), posterior.mode_m, posterior.mean_m, posterior.low_m,
          posterior.high_m, posterior.against_prior, settings_.of_reading[i].extrapolated_column);
  }

 private:
  /// Of the map, where the row has one.
  DistancePrior prior_of(std::size_t i) const {
    DistancePrior prior = base_;
    const double mean = table_->number(i, map_->first).value_or(std::nan("")),
                 sigma = table_->number(i, map_->second).value_or(std::nan(""));
    if (std::isfinite(mean) != std::isfinite(sigma))
      table_->fail(i, std::isfinite(mean) ? map_->second : map_->first,
                   "is missing beside the other of the two");
    if (!std::isfinite(mean)) return prior;
    if (!(sigma > 0.0)) table_->fail(i, map_->second, "is not positive");
    prior.components = {{1.0, mean, sigma, 0.0}};
    return prior;
  }

  void print(AnswerLines& lines, std::size_t i, double reading, const PosteriorTable::Row& row) {
    std::vector<PosteriorRoot> roots;
    for (int i = 0; i < fast_->root_count(); ++i)
      roots.push_back({row.probability[i], row.root_m[i], row.root_std_dev_m[i], 0.0, 0.0});
    print(lines, i, reading, std::move(roots), row.mode_m, row.mean_m, row.low_m, row.high_m);
  }

  /// A line for each root, the most probable first.
  void print(AnswerLines& lines, std::size_t i, double reading, std::vector<PosteriorRoot> roots, double mode,
             double mean, double low, double high, bool against_prior = false, bool column = false) {
    std::sort(roots.begin(), roots.end(),
              [](const auto& a, const auto& b) { return a.probability > b.probability; });
    std::erase_if(roots, [&](const auto& root) { return root.probability < 1e-3; });
    const std::string why = against_prior ? "against_prior" : roots.size() > 1 ? "ambiguous" : "";
    for (std::size_t k = 0; k < roots.size(); ++k) {
      std::string flag = why;
      if (is_extrapolated(settings_.corrector.calibration(), roots[k].mean_m))
        flag += flag.empty() ? "extrapolated" : "+extrapolated";
      if (column) flag += flag.empty() ? "extrapolated_column" : "+extrapolated_column";
      if (k == 0) beyond_.count(flag);
      lines.print(
          i, reading, fmt::format("{:.6f},{:.6f}", roots[k].mean_m, roots[k].std_dev_m),
          std::to_string(k + 1), flag.empty() ? "ok" : flag,
          fmt::format(",{:.4f},{:.6f},{:.6f},{:.6f},{:.6f}", roots[k].probability, mode, mean, low, high));
    }
  }

  const ReadingSettings& settings_;
  const CsvTable* table_;
  double speed_, last_time_ = 0.0;
  DistancePrior base_;
  std::optional<std::pair<std::size_t, std::size_t>> map_;
  std::optional<std::size_t> time_;
  std::optional<DistancePosterior> before_;
  std::unique_ptr<const PosteriorTable> fast_;
  Beyond beyond_;
};

/// Of outliers nothing says which readings they are: distance and std_m are those of all others.
void warn_of_outliers(const Calibration& loaded, const std::string& file) {
  for (const auto& [id, parameters] : loaded.effects) {
    const Effect* effect = find_effect(id);
    const auto share = parameters.find("share");
    if (!effect || effect->info().kind != EffectKind::tail || share == parameters.end()) continue;
    fmt::print(
        stderr,
        "rangecal: warning: {}: it found outliers ({}) in {:.2g} % of its readings; which ones here are such is not known, and "
        "std_m is that of the others\n",
        file, id, 100.0 * share->second);
  }
}

/// Of an effect on one landmark that the calibration does not list (of pairs it lists none) no reading is known to be.
void warn_of_unlisted_landmarks(const Calibration& loaded, const std::string& file) {
  for (const auto& [id, parameters] : loaded.effects) {
    const auto number = parameters.find("landmark");
    if (number == parameters.end() ||
        number->second < static_cast<double>(labels_of_landmarks(loaded).size()))
      continue;
    fmt::print(
        stderr,
        "rangecal: warning: {}: its effect {} is on one landmark whose label it does not hold: the effect is not "
        "undone\n",
        file, id);
  }
}

struct CorrectCommand {
  std::string calibration, file = "-", roots = "ls", prior, output;
  std::vector<double> limits;
  double speed = 0.0;
  bool keep = false;
  ingest::TableOptions own;  ///< of a table that is no recording's
  ingest::BagCorrectionOptions bag;

  int run() const {
    std::error_code ignored;
    const bool is_file = file != "-" && !std::filesystem::is_directory(file, ignored);
    const bool is_bag = is_file && ingest::is_bag(file);
    if (!output.empty() && !is_bag && (file == "-" || (is_file && file_exists(file))))
      throw InputError(file == "-" ? "stdin" : file, 0, "",
                       "is no bag, of which -o would be the corrected one: a table goes to stdout");
    if ((is_bag || !output.empty()) && (keep || own.says_something()))
      throw InputError("--keep, --reading, --unit and the like are about a table, and " + file + " is a bag");
    if (is_bag || !output.empty()) return run_on_bag();
    if (!bag.topic.empty() || !bag.keep_raw.empty() || bag.clockwise)
      throw InputError("--topic, --keep-raw and --clockwise are about a bag, and FILE is none");
    if (roots != "ls" && roots != "ml") throw InputError("--roots is '" + roots + "', not ls or ml");
    require_apart({"/dev/stdout"}, {calibration, file == "-" ? "/dev/stdin" : file});
    const Calibration loaded = curve_of_file();
    const bool from_stdin = file == "-";
    std::string text = from_stdin ? text_of_stdin() : read_file(file, most_bytes);
    if (text.starts_with(byte_order_mark)) text.erase(0, byte_order_mark.size());
    const std::string name = from_stdin ? "stdin" : file;
    std::optional<ingest::ReadingsTable> own_table;
    if (keep || own.says_something()) {
      ingest::TableOptions options = own;
      options.source = name;
      own_table = ingest::read_readings(std::move(options), std::move(text));
      text = std::move(own_table->csv);
      for (const std::string& line : own_table->warnings) fmt::print(stderr, "rangecal: {}\n", line);
      fmt::print(stderr, "rangecal: {}: {}\n", name, own_table->words);
    }
    const ingest::ReadingsTable* const kept = keep ? &*own_table : nullptr;
    const std::vector<double> readings = readings_from(text, name);
    const std::optional<CsvTable> table = table_from(text, name);
    const ReadingSettings settings =
        reading_settings(loaded, table ? &*table : nullptr, name, readings.size());
    if (prior.empty() && (!limits.empty() || speed != 0.0))
      throw InputError("--limits and --speed say what a --prior is; there is none");
    const auto warn_of_effects = [&] {
      if (settings.corrector.takes_effects_as_exact())
        fmt::print(stderr,
                   "rangecal: warning: {}: does not say how well its effects are known, so std_m lacks their "
                   "uncertainty\n",
                   calibration);
    };
    if (!prior.empty()) {
      Posteriors posteriors(settings, prior, limits, speed, table ? &*table : nullptr, name);
      for (std::size_t i = 0; i < readings.size(); ++i) posteriors.check(i);
      posteriors.expect(readings.size());
      warn_of_effects();
      AnswerLines lines(kept, Posteriors::columns);
      for (std::size_t i = 0; i < readings.size(); ++i) posteriors.print(lines, i, readings[i]);
      posteriors.beyond().say(loaded, settings.beyond);
      return done;
    }
    warn_of_effects();
    AnswerLines lines(kept, "");
    Beyond beyond;
    for (std::size_t i = 0; i < readings.size(); ++i) {
      const std::vector<CorrectionCandidate> candidates =
          correction_candidates(settings.corrector, readings[i], settings.of_reading[i], roots == "ml");
      print_correction(lines, i, readings[i], candidates);
      beyond.count(candidates.front().flag);
    }
    beyond.say(loaded, settings.beyond);
    return done;
  }

 private:
  /// The calibration, with the warnings that go with it.
  Calibration curve_of_file() const {
    Calibration loaded = load_calibration(calibration);
    require_curve(loaded, calibration);
    if (loaded.outcome == Outcome::unobservable)
      fmt::print(stderr, "rangecal: warning: {}: {}\n", calibration, loaded.reason);
    if (loaded.left_out && !loaded.left_out->usable)
      fmt::print(stderr, "rangecal: warning: {}: {}\n", calibration, loaded.left_out->reason);
    warn_of_unlisted_landmarks(loaded, calibration);
    warn_of_outliers(loaded, calibration);
    return loaded;
  }

  int run_on_bag() const {
    if (output.empty()) throw InputError(file, 0, "", "is a bag: -o names the corrected one");
    if (roots != "ls" || !prior.empty() || !limits.empty() || speed != 0.0)
      throw InputError("--roots, --prior, --limits and --speed are about a table, and " + file + " is a bag");
    require_apart({output}, {calibration, file});
    require_place_for_file(output);
    const Calibration loaded = curve_of_file();
    ingest::BagCorrectionOptions options = bag;
    if (const auto progress = progress_on_terminal())
      options.progress = [&, progress](double share) mutable { progress(file, share); };
    const ingest::BagCorrected found = ingest::correct_bag(loaded, calibration, file, output, options);
    if (options.progress) options.progress(1.0);
    if (!found.warning.empty()) fmt::print(stderr, "rangecal: {}\n", found.warning);
    fmt::print(
        "{}: {} messages of {}, {} readings: {} corrected, {} no returns kept, {} without a distance (NaN), {} "
        "ambiguous (the most likely distance)\n",
        found.topic, found.messages - found.left_out, found.type, found.readings, found.corrected, found.kept,
        found.without_distance, found.ambiguous);
    fmt::print("written to {} ({})\n", output, found.format);
    Beyond(found).say(loaded, {});
    if (found.extrapolated_column > 0)
      fmt::print(
          stderr,
          "rangecal: {} of {} readings have a bearing, time or intensity outside those over which the effects that use it "
          "were fitted: extrapolated_column\n",
          found.extrapolated_column, found.readings - found.kept);
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
      ->add_option(
          "FILE", state->file,
          "CSV with a column reading_m or range_m, your own table (--reading), or one reading per line; - or "
          "nothing: stdin")
      ->capture_default_str();
  command
      ->add_option(
          "--roots", state->roots,
          "ls: distances where f(d) is the reading; ml: the most likely distances (2016 paper, eq. 27)")
      ->capture_default_str();
  command->add_option(
      "--prior", state->prior,
      "give posteriors: uniform (over --limits), map (columns prior_m, prior_sigma_m: what a map predicts), motion (the "
      "reading before, column time_s, and --speed)");
  command
      ->add_option("--limits", state->limits,
                   "MIN MAX of the distance [m]; else those over which f was fitted")
      ->expected(2);
  command
      ->add_option("-o,--output", state->output,
                   "of a bag: the corrected one, whole or not at all; FILE is a bag by its first bytes")
      ->group("Bags");
  command
      ->add_option("--topic", state->bag.topic,
                   "of sensor_msgs/LaserScan or sensor_msgs/Range; may be left out where the bag has one")
      ->group("Bags");
  command->add_option("--keep-raw", state->bag.keep_raw, "keep the messages as they were under this topic")
      ->group("Bags");
  command
      ->add_flag("--clockwise", state->bag.clockwise, "bearings of the scans run clockwise, as in 'extract'")
      ->group("Bags");
  command->add_flag(
      "--keep", state->keep,
      "print the table's own rows and columns, each row followed by its most likely distance, std_m and flag");
  ingest::add_table_options(*command, state->own, "Your own table, as 'import csv' has it");
  command->add_option("--speed", state->speed, "largest speed along the beam [m/s], for --prior motion");
  add_effects_option(*command);
  command->footer(
      "Prints CSV: reading_m, distance_m, std_m (noise of the reading, uncertainty of f and effects), "
      "candidate (1 is\n"
      "the most likely; every distance that explains the reading is listed), flag. Flags: ok; ambiguous (several\n"
      "distances explain the reading); out_of_range (no distance is read as this, up to a tenth of the range fitted beyond its\n"
      "ends: the nearest is given, or none where it is more than 4 standard deviations off); against_prior (a distance that\n"
      "the map or the motion does not allow); extrapolated (outside the distances fitted, not said beside out_of_range);\n"
      "turning_point (f turns back there); extrapolated_column (a column that an effect uses lies outside the values over\n"
      "which the effects were fitted, as CALIBRATION says, or the landmark or device is not one of these). Several that hold are joined by +, as in ambiguous+extrapolated.\n"
      "Without a distance: out_of_range, or missing, zero, negative, not_finite. How many readings lie beyond the fit is\n"
      "said on stderr.\n"
      "Effects that 'diagnose --calibration' left in CALIBRATION are undone; the CSV then has the columns they need\n"
      "(bearing_rad, time_s from its first reading on, landmark, stop, ...); a missing one is an error that\n"
      "names it (exit code 2, nothing is printed), and a row without its value is flagged missing.\n"
      "A table with other names and units (--reading, --unit, --landmark, --time: as you said to 'import csv') is read as 'import\n"
      "csv' reads it. --keep prints it as it is, with its separator and decimal sign, and three columns more: distance_m, std_m, flag.\n"
      "Of a bag (MCAP, SQLite file of rosbag2) -o is a copy in which every reading of the topic is its most likely distance: no\n"
      "returns stay, what no distance explains becomes nan, all other messages stay byte for byte (docs/bags.md).\n"
      "With --prior each candidate is a part of the curve, distance_m and std_m are those of the posterior on it, and more\n"
      "columns follow: probability (that the distance lies on this part), mode_m, mean_m, low95_m, high95_m (of the whole).\n"
      "\n"
      "Examples:\n"
      "  rangecal correct cal.json readings.csv > distances.csv\n"
      "  rangecal correct cal.json readings.csv --prior motion --speed 0.5\n"
      "  rangecal correct cal.json log.csv --reading 'raw (mm)' --landmark sensor --time stamp --keep > corrected.csv\n"
      "  rangecal correct cal.json run.mcap -o corrected.mcap --topic /scan --keep-raw /scan_raw\n"
      "  echo 1.234 | rangecal correct cal.json");
  command->callback([state, &chosen] { chosen = [state] { return state->run(); }; });
}

}  // namespace rangecal::app
