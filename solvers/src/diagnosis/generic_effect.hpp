// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/rows.hpp"

namespace rangecal::diagnosis {

/// The distance of each landmark for itself: from the landmark's number to 0.9 above it, over the span of all distances.
inline constexpr const char* range_by_landmark = "range by landmark";

using CovariateOf = std::function<double(const ReadingView<double>&)>;

/// The value of a covariate of docs/formats.md at a reading; empty if it is none.
CovariateOf covariate_of(const Rows& rows, const std::string& name);

/// Its value at every reading; NaN where it is missing.
Eigen::VectorXd values_along(const Rows& rows, const CellGeometry& geometry, const CovariateOf& covariate);

/// What a curve can change; none: what no curve corrects.
enum class CurveChannel { range, bearing, range_noise, bearing_noise, none };
CurveChannel curve_channel_of(const std::string& name);
inline bool is_mean(CurveChannel channel) {
  return channel == CurveChannel::range || channel == CurveChannel::bearing;
}

/// Functions of the covariate that the curve is made of.
struct CurveBasis {
  std::vector<double> knots;
  bool groups = false;
  double wavenumber = 0.0;  ///< > 0: cosine and sine instead of hats

  Eigen::Index size() const { return wavenumber > 0.0 ? 2 : static_cast<Eigen::Index>(knots.size()); }

  /// Value at x of the curve with coefficients c; nothing where x is missing.
  double value(double x, const Eigen::VectorXd& c) const {
    return value_of(x, [&c](Eigen::Index k) { return c[k]; });
  }

  /// The same, where c(k) is the coefficient of function k; asks for those that are not 0 at x, two at most.
  template <typename Coefficient>
  double value_of(double x, const Coefficient& c) const {
    if (!std::isfinite(x)) return 0.0;
    if (wavenumber > 0.0) return c(0) * std::cos(wavenumber * x) + c(1) * std::sin(wavenumber * x);
    const auto above = std::lower_bound(knots.begin(), knots.end(), x);
    const auto j = above - knots.begin();
    if (groups) return above != knots.end() && *above == x ? c(j) : 0.0;
    if (above == knots.begin()) return c(0);
    if (above == knots.end()) return c(size() - 1);
    const double share = (x - knots[j - 1]) / (knots[j] - knots[j - 1]);
    return (1.0 - share) * c(j - 1) + share * c(j);
  }
};

/// Cells, or settings, for each parameter of means: fewer follow whatever errors the cells have each for itself.
inline constexpr Eigen::Index cells_of_parameter = 3;

/// True if the recording has so many for every knot of a curve: with one for each it passes through all means, whatever they are.
bool has_cells_for(const Rows& rows, const CurveBasis& basis);

/// At most `count` knots at equal shares of values in ascending order.
std::vector<double> knots_at_equal_shares(const std::vector<double>& sorted, int count);

/// A curve as an effect (see GenericModel): parameters a, coefficients V a of the basis.
class GenericEffect final : public Effect {
 public:
  /// `directions`: V; `typical`: size of a parameter.
  GenericEffect(CurveChannel channel, const std::string& channel_name, const std::string& covariate_name,
                CovariateOf covariate, CurveBasis basis, Eigen::MatrixXd directions, double typical);

  const EffectInfo& info() const override { return info_; }
  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override;
  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int parameter) const override;
  bool changes_with_distance() const override {
    return info_.covariate == "range" || info_.covariate == "disparity" ||
           info_.covariate == range_by_landmark;
  }
  bool differs_between_repeats() const override { return differs_between_repeats_; }
  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override;
  const CurveBasis& basis() const { return basis_; }
  const Eigen::MatrixXd& directions() const { return directions_; }
  double choices = 1.0;  ///< shapes and sizes that it is chosen from along its covariate
  bool smooth = true;    ///< it is not of one shape that may have edges: a step, a stretch, a harmonic

 private:
  Eigen::VectorXd coefficients(const double* p) const {
    return directions_ * Eigen::Map<const Eigen::VectorXd>(p, directions_.cols());
  }

  ReadingChange<double> of_channel(double change) const;

  CurveChannel channel_;
  CovariateOf covariate_;
  CurveBasis basis_;
  Eigen::MatrixXd directions_;
  EffectInfo info_;
  std::string unit_;
  bool differs_between_repeats_;
};

}  // namespace rangecal::diagnosis
