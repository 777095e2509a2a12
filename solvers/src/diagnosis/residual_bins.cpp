// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/residual_bins.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>

namespace rangecal::diagnosis {
namespace {

constexpr int bin_count = 12;

}  // namespace

std::vector<int> bins_of(const Eigen::VectorXd& x) {
  std::vector<int> order, bins(static_cast<std::size_t>(x.size()), -1);
  for (int i = 0; i < x.size(); ++i)
    if (std::isfinite(x[i])) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return x[a] < x[b]; });
  std::set<double> distinct;
  for (int i : order) {
    distinct.insert(x[i]);
    if (distinct.size() > 2 * bin_count) break;
  }
  const bool own = distinct.size() <= 2 * bin_count;  // few values: a bin each
  int bin = -1, begin = 0;
  const int count = static_cast<int>(order.size());
  for (int j = 0; j < count; ++j) {
    const bool changes = j == 0 || x[order[j]] > x[order[j - 1]];
    if (changes &&
        (own || j == 0 ||
         static_cast<long>(j) * bin_count / count > static_cast<long>(begin) * bin_count / count)) {
      ++bin;
      begin = j;
    }
    bins[order[j]] = bin;
  }
  return bins;
}

RowResiduals row_residuals(const Rows& rows, const Model& model, const JointState& state) {
  const CellGeometry geometry = cell_geometry(rows, state);
  const WorkingProblem working = working_problem(rows, model, state);
  const RowChanges changes = row_changes(rows, geometry, model);
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  RowResiduals r;
  r.range = working.range.array();
  r.bearing = working.bearing.array();
  r.range_variance.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const int cell = rows.cell[i];
    r.range[i] -= geometry.f[cell];
    r.range_variance[i] = geometry.spread[cell] * geometry.spread[cell];
  }
  r.range_variance *= changes.range_log_variance.array().exp();
  r.bearing_variance =
      state.sigma_theta_rad * state.sigma_theta_rad * changes.bearing_log_variance.array().exp();
  const CellRounding& rounding = changes.rounding;
  for (Eigen::Index i = 0; !rounding.range.empty() && i < n; ++i) {
    r.range_variance[i] += rounding.range[static_cast<std::size_t>(rows.cell[i])].shared;
    r.bearing_variance[i] += rounding.bearing[static_cast<std::size_t>(rows.cell[i])].shared;
  }
  return r;
}

std::optional<Eigen::VectorXd> covariate_values(const Rows& rows, const CellGeometry& g,
                                                const std::string& name) {
  Eigen::VectorXd x(static_cast<Eigen::Index>(rows.size()));
  const auto fill = [&](auto value) {
    for (Eigen::Index i = 0; i < x.size(); ++i) x[i] = value(static_cast<std::size_t>(i));
    return x;
  };
  if (name == "range" || name == "constant") return fill([&](std::size_t i) { return g.d[rows.cell[i]]; });
  if (name == "disparity") return fill([&](std::size_t i) { return 1.0 / g.d[rows.cell[i]]; });
  if (name == "sensor_bearing") return fill([&](std::size_t i) { return g.bearing[rows.cell[i]]; });
  if (name == "heading") return fill([&](std::size_t i) { return rows.heading_rad[i]; });
  if (name == "time") return fill([&](std::size_t i) { return rows.time_s[i]; });
  if (name == "stop") return fill([&](std::size_t i) { return rows.stop[i]; });
  if (name == "repeat") return fill([&](std::size_t i) { return rows.repeat[i]; });
  if (name == "landmark") return fill([&](std::size_t i) { return rows.landmark[i]; });
  if (name == "radius") return fill([&](std::size_t i) { return rows.radius_m[i]; });
  const std::size_t columns = rows.context.covariates.size();
  for (std::size_t c = 0; c < columns; ++c)
    if (rows.context.covariates[c] == name)
      return fill([&](std::size_t i) { return rows.covariates[i * columns + c]; });
  return std::nullopt;
}

void add_residual_bins(const Rows& rows, const SearchResult& found, const Fit* completed, Diagnosis& result) {
  if (result.location.empty()) return;
  const RowResiduals before = row_residuals(rows, found.baseline.model, found.baseline.state);
  const Fit* final_fit = found.verdict == Verdict::explained ? &found.best.fit : completed;
  const RowResiduals after = final_fit ? row_residuals(rows, final_fit->model, final_fit->state) : before;
  const CellGeometry geometry = cell_geometry(rows, found.baseline.state);
  for (Finding& finding : result.location) {
    const bool noise = finding.channel.find("_noise") != std::string::npos;
    const bool bearing = finding.channel.rfind("bearing", 0) == 0;
    if (!noise && finding.channel != "range" && finding.channel != "bearing") continue;
    const std::optional<Eigen::VectorXd> x = covariate_values(rows, geometry, finding.covariate);
    if (!x) continue;
    const std::vector<int> bins = bins_of(*x);
    const int count = *std::max_element(bins.begin(), bins.end()) + 1;
    std::vector<BinnedResidual> binned(static_cast<std::size_t>(count));
    std::vector<double> variance(static_cast<std::size_t>(count), 0.0);
    for (std::size_t i = 0; i < bins.size(); ++i) {
      if (bins[i] < 0) continue;
      BinnedResidual& b = binned[static_cast<std::size_t>(bins[i])];
      const Eigen::Index row = static_cast<Eigen::Index>(i);
      const auto value = [&](const RowResiduals& r) {
        const double residual = bearing ? r.bearing[row] : r.range[row];
        return noise ? residual * residual / (bearing ? r.bearing_variance[row] : r.range_variance[row])
                     : residual;
      };
      b.at += (*x)[row];
      b.before += value(before);
      b.after += value(after);
      variance[static_cast<std::size_t>(bins[i])] +=
          bearing ? before.bearing_variance[row] : before.range_variance[row];
      ++b.readings;
    }
    for (std::size_t j = 0; j < binned.size(); ++j) {
      BinnedResidual& b = binned[j];
      const double n = std::max(1, b.readings);
      b.at /= n;
      b.before /= n;
      b.after /= n;
      b.std_dev = noise ? std::sqrt(2.0 / n) : std::sqrt(variance[j]) / n;
      if (!noise) continue;
      b.before = std::log(std::max(b.before, 1e-12));
      b.after = std::log(std::max(b.after, 1e-12));
    }
    finding.residuals = std::move(binned);
  }
}

}  // namespace rangecal::diagnosis
