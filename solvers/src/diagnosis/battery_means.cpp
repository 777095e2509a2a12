// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/battery_means.hpp"

#include <cmath>

#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

/// Hat function over the knots, of the j-th.
double hat(const std::vector<double>& knots, std::size_t j, double v) {
  if (v == knots[j]) return 1.0;
  if (j > 0 && v >= knots[j - 1] && v < knots[j]) return (v - knots[j - 1]) / (knots[j] - knots[j - 1]);
  if (j + 1 < knots.size() && v >= knots[j] && v < knots[j + 1])
    return (knots[j + 1] - v) / (knots[j + 1] - knots[j]);
  return 0.0;
}

}  // namespace

Battery::ShapeOf Battery::Values::map(Function f) const {
  return [values = values_, f = std::move(f)] {
    return Shape{values->at.unaryExpr(std::cref(f)), values->moved.unaryExpr(std::cref(f))};
  };
}

Battery::ShapeOf Battery::Values::jump(Function f) const {
  return [values = values_, f = std::move(f)] { return Shape{values->at.unaryExpr(std::cref(f)), {}}; };
}

Battery::ShapeOf Battery::Values::itself() const {
  return [values = values_] { return *values; };
}

std::vector<Battery::ShapeOf> Battery::Values::hats(const std::vector<double>& knots) const {
  std::vector<ShapeOf> shapes;
  for (std::size_t j = 0; j < knots.size(); ++j)
    shapes.push_back(
        map([knots, j](double v) { return hat(knots, j, std::clamp(v, knots.front(), knots.back())); }));
  return shapes;
}

std::vector<double> Battery::Values::quantiles(int count) const {
  Eigen::VectorXd values = at();
  std::sort(values.begin(), values.end());
  std::vector<double> at;
  for (int j = 0; j < count; ++j) {
    const auto index = static_cast<Eigen::Index>(std::lround((values.size() - 1.0) * j / (count - 1.0)));
    if (at.empty() || values[index] > at.back()) at.push_back(values[index]);
  }
  return at;
}

void Battery::ask_means() {
  MeanQuestions of_means(*this);
  for (bool of_bearing : {false, true})
    if (!of_bearing || rows_.reads_bearings()) of_means.ask_channel(of_bearing);
  of_means.ask_waiting();
}

void Battery::MeanQuestions::ask_channel(bool of_bearing) {
  of_bearing_ = of_bearing;
  moved_ = battery_.projector_.moved(of_bearing);
  ask_range();
  ask_sensor_bearing();
  ask_heading();
  ask_time();
  ask_repeat();
  ask_landmarks();
  ask_stops();
  ask_radius();
  for (std::size_t column = 0; column < context_.covariates.size(); ++column) ask_covariate(column);
}

void Battery::MeanQuestions::ask_waiting() {
  std::vector<Asked> asked(waiting_.size());
  in_parallel(waiting_.size(), [&](std::size_t i) {
    asked[i] =
        battery_.asked_of_rows(std::move(waiting_[i].question), waiting_[i].shapes, waiting_[i].of_bearing);
  });
  for (Asked& a : asked) battery_.add(std::move(a));
  waiting_.clear();
}

void Battery::MeanQuestions::ask(const std::string& covariate, const std::string& shape,
                                 std::vector<ShapeOf> shapes, std::optional<double> from,
                                 std::optional<double> to, const std::string& group) {
  Question q;
  q.channel = of_bearing_ ? "bearing" : "range";
  q.covariate = covariate;
  q.shape = shape;
  q.from = from;
  q.to = to;
  q.group = group;
  waiting_.push_back({std::move(q), std::move(shapes), of_bearing_});
  if (waiting_.size() >= most_waiting_) ask_waiting();
}

void Battery::MeanQuestions::ask_smooth(const std::string& covariate, const Values& values, int knots) {
  const std::vector<double> at = values.quantiles(knots);
  if (at.size() < 3) return;
  ask(covariate, "smooth", values.hats(at));
  for (std::size_t j = 0; j + 2 < at.size(); ++j)
    ask(covariate, "bump",
        {values.jump([from = at[j], to = at[j + 2]](double v) { return v >= from && v <= to ? 1.0 : 0.0; })},
        at[j], at[j + 2]);
}

void Battery::MeanQuestions::ask_local(const std::string& covariate, const Values& values,
                                       const std::function<double(double, double)>& difference) {
  const double low = values.at().minCoeff(), span = values.at().maxCoeff() - low;
  if (!(span > 0.0)) return;
  for (const double share : {0.03, 0.06}) {
    const double width = share * span;
    for (double middle = low; middle <= low + span; middle += width)
      ask(covariate, "local bump", {values.map([difference, middle, width](double v) {
            return std::exp(-0.5 * std::pow(difference(v, middle) / width, 2));
          })},
          middle - 2.0 * width, middle + 2.0 * width);
  }
}

Eigen::VectorXd Battery::MeanQuestions::per_row(const OfRow& value) const {
  Eigen::VectorXd values(static_cast<Eigen::Index>(rows_.size()));
  for (Eigen::Index i = 0; i < values.size(); ++i) values[i] = value(static_cast<std::size_t>(i));
  return values;
}

}  // namespace rangecal::diagnosis
