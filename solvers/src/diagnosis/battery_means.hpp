// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/battery.hpp"

namespace rangecal::diagnosis {

/// A covariate over the rows, and by cells the same where these are moved as the projector says (empty: it stays). Functions of it hold on
/// to its values.
class Battery::Values {
 public:
  using Function = std::function<double(double)>;

  explicit Values(Eigen::VectorXd at, Eigen::VectorXd moved = {})
      : values_(std::make_shared<const Shape>(Shape{std::move(at), std::move(moved)})) {}
  const Eigen::VectorXd& at() const { return values_->at; }
  ShapeOf map(Function f) const;
  /// Of a function that jumps: it has no slope.
  ShapeOf jump(Function f) const;
  ShapeOf itself() const;
  /// Together a free piecewise-linear curve.
  std::vector<ShapeOf> hats(const std::vector<double>& knots) const;
  /// Knots at equal shares of the values.
  std::vector<double> quantiles(int count) const;

 private:
  std::shared_ptr<const Shape> values_;
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
    std::vector<ShapeOf> shapes;
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

  void ask(const std::string& covariate, const std::string& shape, std::vector<ShapeOf> shapes,
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
  static Eigen::VectorXd by_cells(const std::vector<double>& values) {
    return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  }
  /// Of the cells, and where they are moved.
  Values of_geometry(std::vector<double> CellGeometry::*value) const {
    return Values(of_cells(geometry_.*value), moved_ ? by_cells(moved_->*value) : Eigen::VectorXd());
  }
  /// Does not follow the cells.
  ShapeOf fixed(OfRow value) const {
    return [this, value = std::move(value)] { return Shape{per_row(value), {}}; };
  }

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
