// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>
#include <vector>

#include "noncentrality.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::proof {

/// What the catalogue's effects do to the noise-free readings of a clean world: their signatures, evaluated at its true
/// geometry and whitened as in SeedModel.
class Signatures {
 public:
  Signatures(const SeedModel& model, std::uint64_t seed);

  /// The noncentrality that the named effects together leave of `signal`: the least over their start grids of the squared
  /// length after projecting out the calibration and the effects' signatures (linear parameters free). Unknown names and
  /// effects that change no mean take nothing. `heading_zero` is a constant of all bearings. Below 7: a twin.
  double left(const Signal& signal, std::span<const std::string> effects) const;
  /// The same for the change of the log variance of range that `planted` makes (noise effects), the fitted sigma projected
  /// out: sum over readings of 1/2 (difference)^2.
  double variance_left(const world::World& planted, std::span<const std::string> effects) const;
  /// The same for the spread of the stops' places where it is independent from stop to stop and one effect spreads them instead:
  /// the least over one of its parameters of 2 (q - 1 - ln q) summed over the stops, q the ratio of the two variances. The noise of
  /// the readings, which would make it less, is left out. Infinity for other plants and effects.
  double stops_left(const world::World& planted, std::span<const std::string> effects) const;

 private:
  using Point = Eigen::VectorXd;
  struct Columns {
    Eigen::MatrixXd means, rows;
    Eigen::VectorXd
        limits;  ///< of the coefficients, in units of the columns: the parameters' physical bounds
  };
  Columns columns(const std::string& id, const Point& point) const;
  Eigen::MatrixXd variance_columns(const std::string& id, const Point& point) const;
  std::vector<Point> grid(const std::string& id) const;
  std::vector<StopPrior> stated_stops() const;
  ReadingView<double> view(std::size_t i) const;

  const SeedModel& model_;
  Recording recording_;
  EffectContext context_;
  std::vector<double> covariates_;
};

}  // namespace rangecal::proof
