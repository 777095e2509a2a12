// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/study/table.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/outcome.hpp"

namespace rangecal {
namespace {

using Values = std::vector<std::optional<double>>;

/// The columns of one measure and, given sums, their values: one list of both, so that they cannot drift apart.
class Columns {
 public:
  Columns(const Study& study, const StudyPointResult* result, int estimator)
      : study_(study), result_(result), layout_(study, study.points[result ? result->point : 0]) {
    if (!result) return;
    row_ = result->sums.numbers.data() + layout_.of(estimator);
    common_ = result->sums.numbers.data() + layout_.bound;
    n_ = row_[layout_.answers];
  }

  void all() {
    add("repeats", [&] { return static_cast<double>(result_->sums.repeats); });
    add("answers", [&] { return n_; });
    for (const StudyMeasure measure : study_.measures) one(measure);
  }

  std::vector<std::string> names;
  Values values;

 private:
  template <typename Value>
  void add(const std::string& name, Value value) {
    names.push_back(name);
    if (!result_) return;
    const double number = value();
    values.push_back(std::isfinite(number) ? std::optional(number) : std::nullopt);
  }

  bool pairs() const { return study_.points.front().scene.kind == RecordingKind::pairs; }
  double at(int slot) const { return row_[slot]; }
  double mean(int slot) const { return at(slot) / n_; }

  /// sqrt of the mean over `count` quantities of (mean error)^2.
  double bias(int errors, int count, int per) const {
    double sum = 0.0;
    for (int i = 0; i < count; ++i) sum += mean(errors + i) * mean(errors + i);
    return std::sqrt(sum / per);
  }
  /// Mean over the quantities of their sample variances.
  double variance(int errors, int squares, int count, int per) const {
    double sum = 0.0;
    for (int i = 0; i < count; ++i) sum += mean(squares + i) - mean(errors + i) * mean(errors + i);
    return std::max(sum, 0.0) / per * n_ / (n_ - 1.0);
  }
  double rmse(int total, int per) const { return std::sqrt(mean(total) / per); }
  /// Of the RMSE, by the delta method from the spread of the repeats' mean squares.
  double rmse_error(int total, int square, int per) const {
    const double spread = mean(square) - mean(total) * mean(total);
    return 0.5 * std::sqrt(std::max(spread, 0.0) / (n_ - 1.0)) / std::sqrt(mean(total) * per);
  }

  /// "landmark" and "curve", with the number of quantities that each is averaged over.
  template <typename Use>
  void for_parts(Use use) {
    const StudyLayout& l = layout_;
    if (!pairs())
      use("landmark", l.landmark_error, l.landmark_square, 2 * l.landmarks, l.landmark_total,
          l.landmark_total_square, l.landmarks);
    use("curve", l.curve_error, l.curve_square, l.curve, l.curve_total, l.curve_total_square, l.curve);
  }

  std::optional<double> bound_sq(bool landmarks) const {
    if (result_->bound) return landmarks ? result_->bound->landmarks_sq : result_->bound->curve_sq;
    if (common_[0] > 0.0) return common_[landmarks ? 1 : 2] / common_[0];
    return std::nullopt;
  }

  void errors(StudyMeasure measure) {
    for_parts([&](const std::string& part, int error, int square, int count, int total, int total_square,
                  int per) {
      const auto bound = [=, this] { return std::sqrt(bound_sq(part == "landmark").value_or(NAN) / per); };
      switch (measure) {
        case StudyMeasure::bias:
          add(part + "_bias_m", [&] { return bias(error, count, per); });
          add(part + "_bias_se_m", [&] { return std::sqrt(variance(error, square, count, per) / n_); });
          break;
        case StudyMeasure::variance:
          add(part + "_variance_m2", [&] { return variance(error, square, count, per); });
          break;
        case StudyMeasure::rmse:
          add(part + "_rmse_m", [&] { return rmse(total, per); });
          add(part + "_rmse_se_m", [&] { return rmse_error(total, total_square, per); });
          break;
        default:
          add(part + "_bound_m", [&] { return bound(); });
          add(part + "_rmse_over_bound", [&] { return rmse(total, per) / bound(); });
          add(part + "_rmse_over_bound_se", [&] { return rmse_error(total, total_square, per) / bound(); });
      }
    });
  }

  double mse(MseSlot slot) const { return at(layout_.mse + slot) / at(layout_.mse + mse_count); }

  /// Of pooled raw / corrected, by the delta method.
  double factor_error() const {
    const double raw = mse(mse_raw), cor = mse(mse_corrected), n = at(layout_.mse + mse_count);
    const double v_raw = mse(mse_raw_square) - raw * raw, v_cor = mse(mse_corrected_square) - cor * cor,
                 both = mse(mse_product) - raw * cor;
    const double relative = v_raw / (raw * raw) + v_cor / (cor * cor) - 2.0 * both / (raw * cor);
    return raw / cor * std::sqrt(std::max(relative, 0.0) / (n - 1.0));
  }

  void mse_columns(const std::string& name) {
    add(name + "_before", [&] { return mse(mse_raw); });
    add(name + "_after", [&] { return mse(mse_corrected); });
    add(name + "_factor", [&] { return mse(mse_raw) / mse(mse_corrected); });
    add(name + "_factor_se", [&] { return factor_error(); });
    add(name + "_ratio_mean", [&] { return mse(mse_ratio_sum); });
    add(name + "_ratio_geometric", [&] { return std::pow(10.0, mse(mse_log)); });
    add(name + "_ratio_log10_std",
        [&] { return std::sqrt(std::max(mse(mse_log_square) - mse(mse_log) * mse(mse_log), 0.0)); });
    add(name + "_factor_without_noise", [&] { return mse(mse_exact_raw) / mse(mse_exact_corrected); });
  }

  void sigma_columns(const std::string& name, int slot) {
    add(name + "_over_true", [&] { return at(slot + 1) / at(slot); });
    add(name + "_over_true_se", [&] {
      const double m = at(slot + 1) / at(slot);
      return std::sqrt(std::max(at(slot + 2) / at(slot) - m * m, 0.0) / (at(slot) - 1.0));
    });
    add(name + "_missing", [&] { return n_ - at(slot); });
  }

  void one(StudyMeasure measure) {
    const StudyLayout& l = layout_;
    switch (measure) {
      case StudyMeasure::bias:
      case StudyMeasure::variance:
      case StudyMeasure::rmse:
      case StudyMeasure::rmse_over_bound:
        errors(measure);
        break;
      case StudyMeasure::mse_ratio:
        mse_columns("mse");
        break;
      case StudyMeasure::normalised_mse:
        mse_columns("nmse");
        break;
      case StudyMeasure::order:
        for (int n = 0; n <= study_.max_order; ++n)
          add(fmt::format("order_{}", n), [&] { return mean(l.order + n); });
        break;
      case StudyMeasure::aic:
        add("aic_repeats", [&] { return at(l.aic); });
        for (int n = 1; n <= study_.max_order; ++n)
          add(fmt::format("aic_{}", n), [&] { return at(l.aic + 1 + n) / at(l.aic); });
        break;
      case StudyMeasure::noise_order:
        for (int s = 0; s < 4; ++s) add(fmt::format("h{}_best", s), [&] { return mean(l.power + s); });
        for (int s = 0; s < 4; ++s)
          add(fmt::format("h{}_log_likelihood", s), [&] { return mean(l.power + 4 + s); });
        break;
      case StudyMeasure::coverage:
        if (!pairs()) add("landmark_coverage95", [&] { return at(l.cover + 1) / at(l.cover); });
        add("curve_coverage95", [&] { return at(l.cover + 3) / at(l.cover + 2); });
        break;
      case StudyMeasure::sigmas:
        sigma_columns("sigma_e", l.sigma_e);
        if (!pairs()) sigma_columns("sigma_theta", l.sigma_theta);
        break;
      case StudyMeasure::failures:
        for (int o = 0; o < study_outcomes; ++o)
          add(to_string(static_cast<Outcome>(o)), [&] { return at(l.outcome + o); });
        break;
      case StudyMeasure::time:
        break;  // in the table of times
    }
  }

  const Study& study_;
  const StudyPointResult* result_;
  StudyLayout layout_;
  const double *row_ = nullptr, *common_ = nullptr;
  double n_ = 0.0;
};

std::string place_header(const Study& study) {
  std::string text = "point";
  for (const StudyParameter& parameter : study.grid) text += "," + csv_label(parameter.name);
  return text + ",estimator";
}

std::string place(const Study& study, int point, const std::string& estimator) {
  std::string text = fmt::format("{}", point);
  for (const std::string& value : study.points[point].values) text += "," + csv_label(value);
  return text + "," + csv_label(estimator);
}

}  // namespace

std::vector<std::string> study_columns(const Study& study) {
  Columns columns(study, nullptr, 0);
  columns.all();
  std::vector<std::string> names{"point"};
  for (const StudyParameter& parameter : study.grid) names.push_back(parameter.name);
  names.push_back("estimator");
  names.insert(names.end(), columns.names.begin(), columns.names.end());
  return names;
}

Values study_values(const Study& study, const StudyPointResult& result, int estimator) {
  Columns columns(study, &result, estimator);
  columns.all();
  return columns.values;
}

std::string study_csv_header(const Study& study) {
  std::string text;
  for (const std::string& name : study_columns(study)) text += (text.empty() ? "" : ",") + csv_label(name);
  return text + "\n";
}

std::string study_csv_rows(const Study& study, const StudyPointResult& result) {
  std::string text;
  for (std::size_t e = 0; e < study.estimators.size(); ++e) {
    text += place(study, result.point, study.estimators[e].label);
    for (const std::optional<double>& value : study_values(study, result, static_cast<int>(e)))
      text += value ? fmt::format(",{}", *value) : ",";
    text += "\n";
  }
  return text;
}

std::string timing_csv_header(const Study& study) { return place_header(study) + ",milliseconds\n"; }

std::string timing_csv_rows(const Study& study, const StudyPointResult& result) {
  std::string text;
  for (std::size_t e = 0; e < result.sums.seconds.size(); ++e)
    text += place(study, result.point, e == 0 ? "simulate" : study.estimators[e - 1].label) +
            fmt::format(",{:.6f}\n", 1e3 * result.sums.seconds[e] / result.sums.repeats);
  return text;
}

}  // namespace rangecal
