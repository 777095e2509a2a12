// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/battery.hpp"

namespace rangecal::diagnosis {

/// A covariate over the rows, and the same where cells are moved as the projector says (empty: it stays).
class Battery::Values {
 public:
  explicit Values(Eigen::VectorXd at, Eigen::VectorXd moved = {})
      : at_(std::move(at)), moved_(std::move(moved)) {}
  const Eigen::VectorXd& at() const { return at_; }
  Shape map(const std::function<double(double)>& f) const;
  /// Of a function that jumps: it has no slope.
  Shape jump(const std::function<double(double)>& f) const { return {map(f).at, {}}; }
  Shape itself() const { return {at_, moved_}; }
  /// Together a free piecewise-linear curve.
  std::vector<Shape> hats(const std::vector<double>& knots) const;
  /// Knots at equal shares of the values.
  std::vector<double> quantiles(int count) const;

 private:
  Eigen::VectorXd at_, moved_;
};

/// The questions about the means, one channel after the other. They are gathered, and asked about together: so
/// many that their rows fit well into memory.
class Battery::MeanQuestions {
 public:
  explicit MeanQuestions(Battery& battery)
      : battery_(battery),
        rows_(battery.rows_),
        context_(rows_.context),
        geometry_(battery.projector_.geometry()),
        duration_(std::max(context_.duration_s, 1e-9)),
        most_waiting_(static_cast<std::size_t>(std::clamp<Eigen::Index>(
            1000000 / std::max<Eigen::Index>(static_cast<Eigen::Index>(rows_.size()), 1), 8, 128))) {}

  void ask_channel(bool of_bearing);
  /// Asks what was gathered.
  void ask_waiting();

 private:
  struct Waiting {
    Question question;
    std::vector<Shape> shapes;
    bool of_bearing;
  };
  using OfRow = std::function<double(std::size_t)>;

  /// A constant, and the distance: its powers, its inverse, a free curve and bumps.
  void ask_range();
  /// The direction in the sensor's frame: its harmonics, a free curve and bumps.
  void ask_sensor_bearing();
  /// The stop's heading: its harmonics.
  void ask_heading();
  /// Time: trends, settling, steps, waves and a free curve.
  void ask_time();
  /// The number of the repeat: a trend and settling.
  void ask_repeat();
  /// Each landmark: an offset, a scale and steps in time of its own.
  void ask_landmarks();
  /// Each stop: an offset of its own.
  void ask_stops();
  /// The landmarks' radius.
  void ask_radius();
  /// One of the recording's own covariates: powers, thresholds and a free curve.
  void ask_covariate(std::size_t column);

  void ask(const std::string& covariate, const std::string& shape, std::vector<Shape> shapes,
           std::optional<double> from = {}, std::optional<double> to = {}, const std::string& group = {});
  /// A free curve, and a bump over two neighbouring intervals of it.
  void ask_smooth(const std::string& covariate, const Values& values, int knots);
  /// One bump somewhere, exp(-u^2 / 2) with u the distance from its middle in widths: at two widths,
  /// everywhere.
  void ask_local(const std::string& covariate, const Values& values,
                 const std::function<double(double, double)>& difference);

  Eigen::VectorXd per_row(const OfRow& value) const;
  Eigen::VectorXd of_cells(const std::vector<double>& values) const {
    return per_row([&](std::size_t i) { return values[rows_.cell[i]]; });
  }
  /// Of the cells, and where they are moved.
  Values of_geometry(std::vector<double> CellGeometry::*value) const {
    return Values(of_cells(geometry_.*value), moved_ ? of_cells(moved_->*value) : Eigen::VectorXd());
  }
  /// Does not follow the cells.
  Shape fixed(const OfRow& value) const { return {per_row(value), {}}; }

  Battery& battery_;
  const Rows& rows_;
  const EffectContext& context_;
  const CellGeometry& geometry_;
  double duration_;
  std::size_t most_waiting_;
  std::vector<Waiting> waiting_;
  bool of_bearing_ = false;              ///< the channel that is asked about
  const CellGeometry* moved_ = nullptr;  ///< by it
};

}  // namespace rangecal::diagnosis
