// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/places.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "diagnosis/residual_bins.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double acting_share = 0.5;   ///< of the largest change: what counts as acting
constexpr double stands_out_by = 2.0;  ///< standard errors of a mean residual that stands out

bool has_place(const Finding& f) { return f.from || f.to || !f.group.empty(); }

/// Labels of the landmarks that are changed most.
std::string landmarks_changed(const Rows& rows, const Eigen::VectorXd& change) {
  const std::vector<std::string>& labels = rows.context.landmark_labels;
  std::vector<double> square(labels.size(), 0.0), count(labels.size(), 0.0);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto l = static_cast<std::size_t>(rows.landmark[i]);
    if (l >= labels.size()) return {};
    square[l] += std::pow(change[static_cast<Eigen::Index>(i)], 2);
    count[l] += 1.0;
  }
  double largest = 0.0;
  for (std::size_t l = 0; l < labels.size(); ++l) {
    square[l] /= std::max(1.0, count[l]);
    largest = std::max(largest, square[l]);
  }
  std::string text;
  for (std::size_t l = 0; l < labels.size(); ++l)
    if (largest > 0.0 && square[l] >= acting_share * acting_share * largest)
      text += (text.empty() ? "" : ", ") + labels[l];
  return text;
}

/// Without the largest gap between them, of angles in (-pi, pi]: from > to where the place holds pi. All around, where no gap
/// is clearly larger than that at pi.
Interval on_circle(std::vector<double> angles) {
  constexpr double clearly = 1.2;
  std::sort(angles.begin(), angles.end());
  Interval interval{angles.front(), angles.back()};
  double gap = clearly * (2.0 * std::numbers::pi - (angles.back() - angles.front()));
  for (std::size_t i = 1; i < angles.size(); ++i)
    if (angles[i] - angles[i - 1] > gap) {
      gap = angles[i] - angles[i - 1];
      interval = {angles[i], angles[i - 1]};
    }
  return interval;
}

}  // namespace

std::optional<Interval> interval_of(const Eigen::VectorXd& x, const Eigen::VectorXd& change, bool circular) {
  double largest = 0.0;
  for (Eigen::Index i = 0; i < x.size(); ++i)
    if (std::isfinite(x[i]) && std::isfinite(change[i])) largest = std::max(largest, std::abs(change[i]));
  if (!(largest > 0.0)) return std::nullopt;
  std::vector<double> acting;
  for (Eigen::Index i = 0; i < x.size(); ++i)
    if (std::isfinite(x[i]) && std::abs(change[i]) >= acting_share * largest) acting.push_back(x[i]);
  if (acting.empty()) return std::nullopt;
  if (circular) return on_circle(std::move(acting));
  const auto [low, high] = std::minmax_element(acting.begin(), acting.end());
  return Interval{*low, *high};
}

std::optional<Interval> interval_of(const std::vector<BinnedResidual>& bins) {
  double largest = 0.0;
  bool stands_out = false;
  for (const BinnedResidual& b : bins) {
    if (!std::isfinite(b.before)) continue;
    largest = std::max(largest, std::abs(b.before));
    stands_out = stands_out || std::abs(b.before) >= stands_out_by * b.std_dev;
  }
  if (!(largest > 0.0)) return std::nullopt;
  const auto acts = [&](const BinnedResidual& b) {
    return std::abs(b.before) >= acting_share * largest &&
           (!stands_out || std::abs(b.before) >= stands_out_by * b.std_dev);
  };
  const auto first = std::find_if(bins.begin(), bins.end(), acts);
  const auto last = std::find_if(bins.rbegin(), bins.rend(), acts).base();  // one behind it
  if (first == bins.end()) return std::nullopt;
  Interval interval{first->at, (last - 1)->at};
  if (first != bins.begin()) interval.from = 0.5 * (interval.from + (first - 1)->at);
  if (last != bins.end()) interval.to = 0.5 * (interval.to + last->at);
  return interval;
}

void close_place(const Rows& rows, const CellGeometry& geometry, Finding& finding) {
  if ((!finding.from && !finding.to) || finding.covariate == "landmark")
    return;  // theirs is a stretch of time
  const std::optional<Eigen::VectorXd> x = covariate_values(rows, geometry, finding.covariate);
  if (!x) return;
  Interval ends{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const double value : *x) {
    if (!std::isfinite(value)) continue;
    ends = {std::min(ends.from, value), std::max(ends.to, value)};
  }
  if (!(ends.from <= ends.to)) return;
  finding.from = std::clamp(finding.from.value_or(ends.from), ends.from, ends.to);
  finding.to = std::clamp(finding.to.value_or(ends.to), ends.from, ends.to);
}

void place_by_change(const Rows& rows, const CellGeometry& geometry, const Eigen::VectorXd& change,
                     Finding& finding) {
  if (!finding.group.empty()) return;
  if (has_place(finding)) return close_place(rows, geometry, finding);
  if (finding.covariate == "constant" || finding.covariate == "any") return;  // no place along it
  if (finding.covariate == "landmark") {
    finding.group = landmarks_changed(rows, change);
    return;
  }
  const std::optional<Eigen::VectorXd> x = covariate_values(rows, geometry, finding.covariate);
  if (!x) return;
  const bool circular = finding.covariate == "sensor_bearing" || finding.covariate == "heading";
  if (const std::optional<Interval> interval = interval_of(*x, change, circular)) {
    finding.from = interval->from;
    finding.to = interval->to;
  }
}

void place_by_residuals(const Rows& rows, std::vector<Finding>& location) {
  for (Finding& f : location) {
    if (has_place(f)) continue;
    const bool alike = f.covariate == "constant" || f.covariate == "any";
    if (!alike && f.covariate != "landmark")
      if (const std::optional<Interval> interval = interval_of(f.residuals)) {
        f.from = interval->from;
        f.to = interval->to;
        continue;
      }
    if (f.covariate == "landmark" && !f.residuals.empty()) {  // a bin each, where there are few
      const auto most = std::max_element(f.residuals.begin(), f.residuals.end(),
                                         [](const BinnedResidual& a, const BinnedResidual& b) {
                                           return std::abs(a.before) < std::abs(b.before);
                                         });
      const auto label = static_cast<std::size_t>(std::lround(most->at));
      if (label < rows.context.landmark_labels.size()) f.group = rows.context.landmark_labels[label];
      if (!f.group.empty()) continue;
    }
    f.everywhere = alike ? "it is asked of all readings alike"
                         : "it is asked of all readings alike: no mean changes along the covariate";
  }
}

}  // namespace rangecal::diagnosis
