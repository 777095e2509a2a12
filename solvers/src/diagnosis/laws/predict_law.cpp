// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/predict_law.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <vector>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/generic.hpp"
#include "diagnosis/held_out.hpp"
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

/// Something that a law may depend on, as it is varied alone.
struct Varied {
  std::string name, unit;
  double low = 0.0, high = 0.0;
  std::function<double(std::size_t)> here;                         ///< of a row
  std::function<void(ReadingView<double>&, double*, double)> set;  ///< view, its columns, value
};

std::vector<Varied> variables_of(const diagnosis::Rows& rows, const diagnosis::CellGeometry& geometry) {
  const auto cell = [&](std::size_t i) { return static_cast<std::size_t>(rows.cell[i]); };
  constexpr double pi = std::numbers::pi, beyond = 1.5;  // of the largest distance here
  const double farthest = *std::max_element(geometry.d.begin(), geometry.d.end());
  std::vector<Varied> all;
  all.push_back({"d", "m", 0.0, beyond * farthest, [&, cell](std::size_t i) { return geometry.d[cell(i)]; },
                 [](ReadingView<double>& view, double*, double x) { view.d = view.f = x; }});
  if (!rows.pairs)
    all.push_back({"b", "rad", -pi, pi, [&, cell](std::size_t i) { return geometry.bearing[cell(i)]; },
                   [](ReadingView<double>& view, double*, double x) { view.bearing = x; }});
  const std::size_t columns = rows.context.covariates.size();
  for (std::size_t c = 0; c < columns; ++c) {
    const std::string& name = rows.context.covariates[c];
    if (!is_column_of_formulas(name)) continue;
    const auto here = [&rows, columns, c](std::size_t i) { return rows.covariates[i * columns + c]; };
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (std::isfinite(here(i))) low = std::min(low, here(i)), high = std::max(high, here(i));
    if (!(low <= high)) continue;
    const double span = std::max(high - low, 0.1 * std::abs(high));
    all.push_back({name, unit_of_column_in_formulas(name), low - span, high + span, here,
                   [c](ReadingView<double>&, double* covariates, double x) { covariates[c] = x; }});
  }
  return all;
}

/// Readings that would show a law best, where it acts in less than a third of what it depends on; empty: it acts all over.
std::string where_it_acts(const Effect& law, const Eigen::VectorXd& values, const diagnosis::Rows& rows,
                          const JointState& state) {
  using namespace diagnosis;
  constexpr int points = 240;
  constexpr std::size_t others = 24;  // readings at which the rest of what it depends on is held
  const CellGeometry geometry = cell_geometry(rows, state);
  const std::size_t columns = rows.context.covariates.size();
  std::string words;
  for (const Varied& v : variables_of(rows, geometry)) {
    std::vector<double> size(points, 0.0);  // the largest change at each value
    for (std::size_t k = 0; k < others; ++k) {
      const std::size_t row = k * (rows.size() - 1) / (others - 1);
      ReadingView<double> view = view_of(rows, geometry, row);
      std::vector<double> covariates(
          rows.covariates.begin() + static_cast<std::ptrdiff_t>(row * columns),
          rows.covariates.begin() + static_cast<std::ptrdiff_t>((row + 1) * columns));
      view.covariate = covariates.data();
      for (int j = 0; j < points; ++j) {
        v.set(view, covariates.data(), v.low + (j + 0.5) * (v.high - v.low) / points);
        size[static_cast<std::size_t>(j)] = std::max(
            size[static_cast<std::size_t>(j)], std::abs(of_any_channel(law.reading(view, values.data()))));
      }
    }
    const auto most = std::max_element(size.begin(), size.end());
    const auto acting = std::count_if(size.begin(), size.end(), [&](double x) { return x > 0.5 * *most; });
    if (3 * acting >= points) continue;  // all over: lines, waves
    auto begin = most, end = most;
    while (begin != size.begin() && *(begin - 1) > 0.5 * *most) --begin;
    while (end + 1 != size.end() && *(end + 1) > 0.5 * *most) ++end;
    const double step = (v.high - v.low) / points;
    const double low = v.low + static_cast<double>(begin - size.begin()) * step,
                 high = v.low + static_cast<double>(end + 1 - size.begin()) * step;
    int here = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) here += v.here(i) >= low && v.here(i) <= high;
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
