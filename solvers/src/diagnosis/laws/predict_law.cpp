// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/predict_law.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <vector>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/generic.hpp"
#include "diagnosis/held_out.hpp"
#include "diagnosis/laws/pieces.hpp"
#include "diagnosis/search.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/names.hpp"

namespace rangecal {

namespace {

constexpr double surely = 3.0;  ///< standard deviations

constexpr auto law_verdicts =
    names_of<LawVerdict>("verdict on a law", {{LawVerdict::confirmed, "confirmed"},
                                              {LawVerdict::another_size, "another_size"},
                                              {LawVerdict::refuted, "refuted"},
                                              {LawVerdict::not_tested, "not_tested"}});

/// A law at parameters that are held: s g(.; p), or g alone where it has no size of its own.
class HeldLaw final : public Effect {
 public:
  HeldLaw(const Effect& law, Eigen::VectorXd values, bool sized)
      : law_(law), values_(std::move(values)), sized_(sized) {
    info_ = law.info();
    info_.parameters.clear();
    if (sized) info_.parameters = {{.name = "size", .typical = 1.0, .low = -100.0, .high = 100.0}};
  }

  const EffectInfo& info() const override { return info_; }
  std::string missing(const EffectContext& context) const override { return law_.missing(context); }
  bool changes_with_distance() const override { return law_.changes_with_distance(); }
  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return times(sized_ ? p[0] : 1.0, law_.reading(at, values_.data()));
  }
  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double*,
                                             int) const override {
    return law_.reading(at, values_.data());
  }

 private:
  static ReadingChange<double> times(double s, ReadingChange<double> change) {
    change.range *= s;
    change.bearing *= s;
    change.range_log_variance *= s;
    change.bearing_log_variance *= s;
    return change;
  }

  const Effect& law_;
  Eigen::VectorXd values_;
  bool sized_;
  EffectInfo info_;
};

LawVerdict verdict_of(const LawPrediction& p) {
  const double off = p.size - 1.0, std_dev = std::hypot(p.size_std, p.found_std);
  if (p.size > surely * p.size_std)
    return std::abs(off) < surely * std_dev ? LawVerdict::confirmed : LawVerdict::another_size;
  return -off > surely * std_dev ? LawVerdict::refuted : LawVerdict::not_tested;
}

/// A reading's change in all channels, each in units of its own: of a law one alone differs from 0.
double of_any_channel(const ReadingChange<double>& change) {
  return change.range + change.bearing + change.range_log_variance + change.bearing_log_variance;
}

/// The standard deviation of the law's size by that of its parameters.
double found_std_of(const Effect& law, const StatedValues& values, const diagnosis::Rows& rows,
                    const JointState& state) {
  using namespace diagnosis;
  const CellGeometry geometry = cell_geometry(rows, state);
  const auto change_at = [&](const Eigen::VectorXd& p) {
    Eigen::VectorXd change(static_cast<Eigen::Index>(rows.size()));
    for (Eigen::Index i = 0; i < change.size(); ++i)
      change[i] = of_any_channel(law.reading(view_of(rows, geometry, static_cast<std::size_t>(i)), p.data()));
    return change;
  };
  const Eigen::VectorXd g = change_at(values.value);
  double variance = 0.0;
  for (Eigen::Index j = 0; g.squaredNorm() > 0.0 && j < values.value.size(); ++j) {
    if (!(values.std_dev[j] > 0.0)) continue;
    constexpr double of_std_dev = 0.1;
    const Eigen::VectorXd step =
        Eigen::VectorXd::Unit(values.value.size(), j) * of_std_dev * values.std_dev[j];
    const Eigen::VectorXd rise = change_at(values.value + step) - change_at(values.value - step);
    variance += std::pow(rise.dot(g) / g.squaredNorm() / (2.0 * of_std_dev), 2);
  }
  return std::sqrt(variance);
}

/// Where a variable of laws stands in a reading's view; `columns` are those that the view points to. Not of times: those of two
/// recordings have nothing in common.
double& value_in(ReadingView<double>& view, std::vector<double>& columns, const diagnosis::LawVariable& v) {
  if (v.column >= 0) return columns[static_cast<std::size_t>(v.column)];
  return v.is_angle ? view.bearing : view.d;
}

/// Readings that would show a law best, where it acts in less than a third of what it depends on; empty: it acts all over.
std::string where_it_acts(const Effect& law, const Eigen::VectorXd& values, const diagnosis::Rows& rows,
                          const JointState& state) {
  using namespace diagnosis;
  constexpr std::size_t points = 240;
  constexpr std::size_t others = 24;  // readings at which the rest of what it depends on is held
  constexpr double pi = std::numbers::pi;
  const CellGeometry geometry = cell_geometry(rows, state);
  std::vector<double> columns(rows.context.covariates.size());
  const auto view_at = [&](std::size_t row) {
    const auto begin = rows.covariates.begin() + static_cast<std::ptrdiff_t>(row * columns.size());
    std::copy_n(begin, columns.size(), columns.begin());
    ReadingView<double> view = view_of(rows, geometry, row);
    view.covariate = columns.data();
    return view;
  };
  std::string words;
  for (LawVariable v : law_variables(rows)) {
    if (v.name == "t") continue;
    // Beyond what was recorded: a law may act where nothing was.
    const double margin = std::max(v.span(), 0.1 * std::abs(v.high));
    if (v.is_angle)
      v.low = -pi, v.high = pi;
    else if (v.column < 0)
      v.low = 0.0, v.high = 1.5 * *std::max_element(geometry.d.begin(), geometry.d.end());
    else
      v.low -= margin, v.high += margin;
    const double step = v.span() / static_cast<double>(points);
    std::vector<double> size(points, 0.0);  // the largest change about each value
    for (std::size_t k = 0; k < others; ++k) {
      ReadingView<double> view = view_at(k * (rows.size() - 1) / (others - 1));
      for (std::size_t j = 0; j < points; ++j) {
        value_in(view, columns, v) = v.low + (static_cast<double>(j) + 0.5) * step;
        size[j] = std::max(size[j], std::abs(of_any_channel(law.reading(view, values.data()))));
      }
    }
    const auto most = static_cast<std::size_t>(std::max_element(size.begin(), size.end()) - size.begin());
    const auto acts = [&](std::size_t j) { return size[j] > 0.5 * size[most]; };
    std::size_t acting = 0;
    for (std::size_t j = 0; j < points; ++j) acting += acts(j);
    if (acting == 0 || 3 * acting >= points) continue;  // nothing; lines and waves
    // The stretch about the largest change; that of directions may lead through the one backwards.
    const auto is_end = [&](std::size_t j, std::size_t edge) { return !v.is_angle && j == edge; };
    std::size_t first = most, last = most;
    while (!is_end(first, 0) && acts((first + points - 1) % points)) first = (first + points - 1) % points;
    while (!is_end(last, points - 1) && acts((last + 1) % points)) last = (last + 1) % points;
    const double low = v.low + static_cast<double>(first) * step,
                 high = v.low + static_cast<double>(last + 1) * step;
    int here = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      ReadingView<double> view = view_at(i);
      const double x = value_in(view, columns, v);
      here += low <= high ? x >= low && x <= high : x >= low || x <= high;
    }
    words += fmt::format("{}{} from {:.3g} to {:.3g}{} ({} of {} here)",
                         words.empty() ? "readings with " : " and ", v.name, low, high,
                         v.unit == "1" ? "" : " " + v.unit, here, rows.size());
  }
  return words;
}

/// How many times as many readings, each independent of the others, leave a sixth as the standard deviation of s - 1.
std::optional<double> times_the_readings(const LawPrediction& p) {
  constexpr double wanted = 1.0 / (2.0 * surely);
  const double of_readings_sq = wanted * wanted - p.found_std * p.found_std;
  if (!(of_readings_sq > 0.0)) return std::nullopt;
  return std::max(1.0, p.size_std * p.size_std / of_readings_sq);
}

}  // namespace

const char* to_string(LawVerdict verdict) { return law_verdicts.name_of(verdict); }

LawPrediction predict_law(const Effect& law, const StatedValues& values,
                          std::span<const Recording> recordings) {
  using namespace diagnosis;
  const EffectInfo& info = law.info();
  if (info.kind != EffectKind::mean && info.kind != EffectKind::noise)
    throw std::invalid_argument("a law changes the mean or the variance of readings");
  if (values.value.size() != static_cast<Eigen::Index>(info.parameters.size()) ||
      values.std_dev.size() != values.value.size())
    throw std::invalid_argument("a law needs a value for each of its parameters");
  const Rows rows = make_rows(recordings);
  constexpr std::size_t fewest = 8;
  if (rows.size() < fewest)
    throw InputError(recordings[0].path + ": fewer than 8 usable readings: nothing can be predicted");
  LawPrediction prediction;
  if (const std::string missing = law.missing(rows.context); !missing.empty()) {
    prediction.reason = "the recording lacks " + missing;
    return prediction;
  }
  const DiagnoseOptions options;
  RefitOptions refit_options;
  const SearchResult seed = scan_seed_model(rows, find_grids_and_gaps(rows), options, refit_options);
  const HeldLaw sized(law, values.value, true), held(law, values.value, false);
  const Fit with_size = refit(rows, {{&sized, Eigen::VectorXd::Ones(1)}}, seed.baseline.state, refit_options);
  if (!with_size.ok || with_size.covariance.rows() != 1 || !(with_size.covariance(0, 0) > 0.0)) {
    prediction.reason = "these readings do not determine its size";
    prediction.would_test = where_it_acts(law, values.value, rows, seed.baseline.state);
    return prediction;
  }
  prediction.size = with_size.model[0].parameters[0];
  prediction.size_std = std::sqrt(with_size.covariance(0, 0));
  prediction.found_std = found_std_of(law, values, rows, with_size.state);
  prediction.verdict = verdict_of(prediction);
  if (prediction.verdict == LawVerdict::not_tested) {
    prediction.would_test = where_it_acts(law, values.value, rows, with_size.state);
    prediction.times_the_readings = times_the_readings(prediction);
  }

  const Fit as_found = refit(rows, {{&held, Eigen::VectorXd(0)}}, seed.baseline.state, refit_options);
  if (!as_found.ok) return prediction;
  const std::optional<HeldOutChange> by_law = held_out_change(rows, seed, as_found);
  if (!by_law) return prediction;
  prediction.heldout_gain = -by_law->nll;
  prediction.heldout_gain_std = by_law->std_dev;
  Question question;
  question.channel = info.channel;
  question.covariate = info.covariate;
  const std::optional<CurveFit> curve =
      fit_curve(rows, seed.first->projector(), seed.baseline, question, refit_options);
  const std::optional<HeldOutChange> of_curve =
      curve ? held_out_change(rows, seed, curve->fit, as_found) : std::nullopt;
  if (!of_curve) return prediction;
  prediction.heldout_gain_over_curve = -of_curve->nll;
  prediction.heldout_gain_over_curve_std = of_curve->std_dev;
  return prediction;
}

}  // namespace rangecal
