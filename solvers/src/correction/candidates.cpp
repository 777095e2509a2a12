// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/candidates.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

std::string why_unusable(double reading) {
  if (std::isnan(reading)) return "missing";
  if (!std::isfinite(reading)) return "not_finite";
  return reading == 0.0 ? "zero" : reading < 0.0 ? "negative" : "";
}

CorrectionCandidate candidate_of(const CorrectionRoot& root, int number, std::string flags,
                                 const ReadingSetting& setting) {
  const auto add = [&](const char* flag) { flags += (flags.empty() ? "" : "+") + std::string(flag); };
  if (root.extrapolated && flags != "out_of_range") add("extrapolated");
  if (root.turning_point) add("turning_point");
  if (setting.extrapolated_column) add("extrapolated_column");
  return {root.distance_m, root.std_dev_total_m ? root.std_dev_total_m : root.std_dev_m, number,
          flags.empty() ? "ok" : flags};
}

/// Numbers of the calibration's stops or landmarks by their labels.
using LabelNumbers = std::unordered_map<std::string, int>;

LabelNumbers label_numbers(const std::vector<std::string>& labels) {
  LabelNumbers numbers;
  for (std::size_t i = 0; i < labels.size(); ++i) numbers.emplace(labels[i], static_cast<int>(i));
  return numbers;
}

std::vector<std::string> labels_of_stops(const Calibration& calibration) {
  std::vector<std::string> labels;
  for (const StopEstimate& stop : calibration.stops) labels.push_back(stop.label);
  return labels;
}

/// -1 where the label is none of them.
int labelled(const LabelNumbers& numbers, const std::string& label) {
  const auto found = numbers.find(label);
  return found == numbers.end() ? -1 : found->second;
}

std::vector<std::string> numeric_columns(const CsvTable& table) {
  std::vector<std::string> names;
  for (std::size_t c = 0; c < table.columns().size(); ++c)
    if (table.is_numeric(c)) names.push_back(table.columns()[c]);
  return names;
}

/// Throws InputError for the columns that effects need and the table lacks; a stop stands for its heading.
void require_columns(const Calibration& calibration, const CsvTable* table, const std::string& name,
                     const std::vector<EffectCorrector::Need>& needs) {
  std::vector<const EffectCorrector::Need*> missing;  // one of each column
  for (const EffectCorrector::Need& need : needs) {
    const bool by_stop =
        need.column == "heading_rad" && table && table->find("stop") && !calibration.stops.empty();
    if (by_stop || (table && table->find(need.column))) continue;
    if (std::none_of(missing.begin(), missing.end(), [&](const auto* m) { return m->column == need.column; }))
      missing.push_back(&need);
  }
  if (missing.empty()) return;
  std::string why = "is missing: the calibration's effect " + missing[0]->effect + " needs it to be undone";
  for (std::size_t i = 1; i < missing.size(); ++i)
    why += "; so is '" + missing[i]->column + "' for " + missing[i]->effect;
  throw InputError(name, 1, missing[0]->column, why);
}

/// Those of which a reading has a member of its own; any other is a covariate.
constexpr std::array own_columns = {"bearing_rad", "heading_rad", "time_s", "radius_m",
                                    "landmark",    "stop",        "repeat"};

/// What the rows of a table say of their readings. Only what an effect needs can be wanting: a column of no use may be
/// empty, or hold other than numbers.
class SettingRows {
 public:
  SettingRows(const Calibration& calibration, const CsvTable& table,
              const std::vector<EffectCorrector::Need>& needs, const std::vector<std::string>& covariates)
      : calibration_(calibration),
        table_(table),
        landmark_numbers_(label_numbers(labels_of_landmarks(calibration))),
        stop_numbers_(label_numbers(labels_of_stops(calibration))) {
    const auto needed = [&](std::string_view column) {
      return std::any_of(needs.begin(), needs.end(), [&](const auto& need) { return need.column == column; });
    };
    const auto field = [&](std::string_view column) { return Field{table.find(column), needed(column)}; };
    const auto number = [&](std::string_view column) {
      Field found = field(column);
      if (found.column && !found.needed && !table.is_numeric(*found.column)) found.column.reset();
      return found;
    };
    bearing_ = number("bearing_rad"), heading_ = number("heading_rad"), time_ = number("time_s");
    radius_ = number("radius_m"), repeat_ = number("repeat");
    landmark_ = field("landmark"), stop_ = field("stop");
    for (const std::string& name : covariates) covariates_.push_back(field(name));
    for (const auto& [column, range] : calibration.effects_range)
      if (needed(column)) {
        ranged_.push_back(field(column));
        beyond_.push_back({column, range.first, range.second, 0, 0});
      }
    // An effect on one landmark leaves all others as they are. What any other that needs the landmark does is known of those alone that it
    // was fitted to.
    labels_matter_ = std::any_of(needs.begin(), needs.end(), [&](const EffectCorrector::Need& need) {
      const auto effect = calibration.effects.find(need.effect);
      return need.column == "landmark" && effect != calibration.effects.end() &&
             !effect->second.contains("landmark");
    });
    for (const EffectCorrector::Need& need : needs)
      if (std::find(own_columns.begin(), own_columns.end(), need.column) == own_columns.end())
        wanted_.push_back(field(need.column));
    if (time_.column)
      for (std::size_t row = 0; row < table.rows(); ++row)
        if (const double at = value(row, time_); std::isfinite(at)) first_time_ = std::min(first_time_, at);
  }

  /// Of the columns met so far, those with values beyond.
  std::vector<ColumnBeyond> beyond() const {
    std::vector<ColumnBeyond> met = beyond_;
    met.push_back(unknown_label_);
    std::erase_if(met, [](const ColumnBeyond& one) { return one.readings == 0; });
    return met;
  }

  ReadingSetting operator()(std::size_t row) {
    ReadingSetting at;
    at.bearing_rad = angle(row, bearing_);
    at.heading_rad = angle(row, heading_);
    at.radius_m = value(row, radius_);
    at.time_s = value(row, time_) - first_time_;
    if (const auto label = label_in(row, landmark_)) {
      at.landmark = labelled(landmark_numbers_, *label);
      if (labels_matter_ && at.landmark < 0) {
        at.extrapolated_column = true;
        if (++unknown_label_.readings == 1)
          unknown_label_.label = *label, unknown_label_.first_row = table_.line(row);
      }
    }
    if (const auto label = label_in(row, stop_)) at.stop = labelled(stop_numbers_, *label);
    if (at.stop >= 0 && !std::isfinite(at.heading_rad))
      at.heading_rad = calibration_.stops[static_cast<std::size_t>(at.stop)].pose.heading_rad;
    const bool repeat = std::isfinite(value(row, repeat_));
    if (repeat) at.repeat = table_.count(row, *repeat_.column);
    const auto has = [](const Field& field, bool there) { return there || !field.needed; };
    // Each is looked at, whatever else the row lacks: a text in one makes its column no covariate, for all rows.
    const auto given = std::count_if(wanted_.begin(), wanted_.end(),
                                     [&](const Field& field) { return std::isfinite(value(row, field)); });
    at.complete = has(bearing_, std::isfinite(at.bearing_rad)) &&
                  has(heading_, std::isfinite(at.heading_rad)) && has(radius_, std::isfinite(at.radius_m)) &&
                  has(time_, std::isfinite(at.time_s)) && has(landmark_, is_there(row, landmark_)) &&
                  has(stop_, is_there(row, stop_)) && has(repeat_, repeat) &&
                  given == static_cast<std::ptrdiff_t>(wanted_.size());
    at.covariates.reserve(covariates_.size());
    for (const Field& field : covariates_) at.covariates.push_back(value(row, field));
    for (std::size_t i = 0; i < ranged_.size(); ++i)
      if (lies_beyond(beyond_[i], at, value(row, ranged_[i]))) {
        at.extrapolated_column = true;
        if (++beyond_[i].readings == 1) beyond_[i].first_row = table_.line(row);
      }
    return at;
  }

 private:
  struct Field {
    std::optional<std::size_t> column;
    bool needed = false;
  };

  static bool lies_beyond(const ColumnBeyond& fitted, const ReadingSetting& at, double value) {
    const bool bearing = fitted.column == "bearing_rad";
    if (bearing || fitted.column == "heading_rad") {
      const double angle = bearing ? at.bearing_rad : at.heading_rad;
      return std::isfinite(angle) && !is_on_arc(angle, {fitted.from, fitted.to});
    }
    if (fitted.column == "time_s") value = at.time_s;
    return value < fitted.from || value > fitted.to;  // false of NaN: the row is not complete
  }
  bool is_there(std::size_t row, const Field& field) const {
    return field.column && !table_.text(row, *field.column).empty();
  }
  double value(std::size_t row, const Field& field) const {
    return field.column ? table_.number(row, *field.column).value_or(std::nan("")) : std::nan("");
  }
  double angle(std::size_t row, const Field& field) const {
    const double radians = value(row, field);
    if (field.needed && std::abs(radians) > 2.0 * std::numbers::pi)
      table_.fail(row, *field.column, "is beyond 2 pi: radians are needed");
    return radians;
  }
  std::optional<std::string> label_in(std::size_t row, const Field& field) const {
    if (!is_there(row, field)) return std::nullopt;
    return table_.label(row, *field.column);
  }

  const Calibration& calibration_;
  const CsvTable& table_;
  LabelNumbers landmark_numbers_, stop_numbers_;
  Field bearing_, heading_, time_, radius_, repeat_, landmark_, stop_;
  std::vector<Field> covariates_, wanted_, ranged_;
  std::vector<ColumnBeyond> beyond_;  ///< of ranged_
  bool labels_matter_ = false;
  ColumnBeyond unknown_label_{.column = "landmark"};
  double first_time_ = std::numeric_limits<double>::infinity();
};

}  // namespace

std::vector<CorrectionCandidate> correction_candidates(const EffectCorrector& corrector, double reading_m,
                                                       const ReadingSetting& setting,
                                                       bool maximum_likelihood) {
  if (const std::string why = setting.complete ? why_unusable(reading_m) : "missing"; !why.empty())
    return {{std::nullopt, std::nullopt, 0, why}};
  const Correction found = corrector.correct(reading_m, setting);
  std::vector<CorrectionRoot> roots = maximum_likelihood ? found.maximum_likelihood : found.least_squares;
  if (maximum_likelihood)  // a turning point is a minimum of the NLL, however far the reading lies from it
    std::erase_if(roots, [](const CorrectionRoot& root) { return !(root.off <= farthest_off); });
  std::sort(roots.begin(), roots.end(), [](const CorrectionRoot& a, const CorrectionRoot& b) {
    return a.log_likelihood > b.log_likelihood;
  });
  if (roots.empty()) {
    if (found.nearest && found.nearest->off <= farthest_off)
      return {candidate_of(*found.nearest, 1, "out_of_range", setting)};
    return {{std::nullopt, std::nullopt, 0, "out_of_range"}};
  }
  std::vector<CorrectionCandidate> candidates;
  const char* flag = found.least_squares.empty() ? "out_of_range" : roots.size() > 1 ? "ambiguous" : "";
  for (std::size_t i = 0; i < roots.size(); ++i)
    candidates.push_back(candidate_of(roots[i], static_cast<int>(i + 1), flag, setting));
  return candidates;
}

ReadingSettings reading_settings(const Calibration& calibration, const CsvTable* table,
                                 const std::string& name, std::size_t count) {
  std::vector<std::string> covariates;
  if (table && !calibration.effects.empty()) covariates = numeric_columns(*table);
  ReadingSettings settings{EffectCorrector(calibration, covariates), std::vector<ReadingSetting>(count)};
  if (calibration.effects.empty()) return settings;
  const std::vector<EffectCorrector::Need> needs = settings.corrector.needs();
  require_columns(calibration, table, name, needs);
  if (!table) return settings;
  SettingRows rows(calibration, *table, needs, covariates);
  for (std::size_t row = 0; row < count; ++row) settings.of_reading[row] = rows(row);
  settings.beyond = rows.beyond();
  return settings;
}

void require_curve(const Calibration& calibration, const std::string& name) {
  const bool open_curve = calibration.outcome == Outcome::unobservable && !calibration.alpha_covariance;
  if (!is_usable(calibration.outcome) || open_curve)
    throw InputError(name + ": its outcome is " + to_string(calibration.outcome) +
                     ", so it cannot correct readings");
}

}  // namespace rangecal
