// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/findings.hpp"

#include <algorithm>
#include <cmath>

namespace rangecal::diagnosis {

namespace {

bool has_grid_of(const Bookkeeping& known, const std::string& readings) {
  return std::any_of(known.findings.begin(), known.findings.end(), [&](const Question& f) {
    return f.channel == "grid" && (f.covariate == "range") == (readings == "range");
  });
}

}  // namespace

bool channel_is_on_grid(const Bookkeeping& known, const std::string& channel) {
  const auto suffix = channel.find('_');
  return known.coarse && suffix != std::string::npos && has_grid_of(known, channel.substr(0, suffix));
}

bool on_grid(const Bookkeeping& known, const Question& q) {
  if (q.channel == "grid")
    return has_grid_of(known, q.covariate);  // whether its variance is there, which the model says
  if (q.channel == "detection" && q.of == Question::Of::variance)
    return has_grid_of(known, "range");  // what missing readings take off the spread
  return channel_is_on_grid(known, q.channel);
}

/// Squares and products of the stops' errors are tested as if they were normal;
/// far out z^2 / 2 exceeds what any fit of their spread can gain: K stops of 1 + x times the squared error
/// stated, or whose neighbours agree so well that it takes that much, gain K (x - ln(1 + x)).
double gain_of(const Rows& rows, const Question& q) {
  if (q.channel != "stop" || q.of != Question::Of::scalar || !(q.size > 0.0)) return q.gain;
  return std::min(q.gain, rows.problem.stop_count() * (q.size - std::log1p(q.size)));
}

double price_of_curve_parameter(const Rows& rows) {
  return 0.5 * std::log(std::max(10.0, 2.0 * rows.cell_count));
}

std::vector<Question> findings(const Rows& rows, const Battery& battery, double alarm_rate) {
  std::vector<Question> shapes;
  for (const Question& q : battery.questions)
    if (!q.effect) shapes.push_back(q);
  const double price = price_of_curve_parameter(rows);
  // A shape of the mean makes readings of a cell hang together, never the other way round: dependence stands
  // back.
  const auto worth = [&](const Question& q) {
    const bool secondary = q.channel.find("_dependence") != std::string::npos ||
                           q.channel.find("_tail") != std::string::npos || q.channel == "stop";
    return (secondary ? 0.6 : 1.0) * gain_of(rows, q) - price * q.dof;
  };
  std::sort(shapes.begin(), shapes.end(),
            [&](const Question& a, const Question& b) { return worth(a) > worth(b); });
  // A column that rises with time says no more than time does, unless it is clearly better.
  constexpr double clearly = 3.0;  // nats
  for (auto column = shapes.begin(); column != shapes.end(); ++column) {
    const auto& names = rows.context.covariates;
    if (std::find(names.begin(), names.end(), column->covariate) == names.end()) continue;
    const auto time = std::find_if(column, shapes.end(), [&](const Question& q) {
      return q.channel == column->channel && q.covariate == "time";
    });
    if (time != shapes.end() && worth(*time) > worth(*column) - clearly) std::rotate(column, time, time + 1);
  }
  std::vector<Question> kept;
  for (Question& q : shapes) {
    const bool seen = std::any_of(kept.begin(), kept.end(), [&](const Question& k) {
      return k.channel == q.channel && k.covariate == q.covariate;
    });
    if (!seen && battery.corrected(q) < alarm_rate) kept.push_back(std::move(q));
    if (kept.size() == 5) break;
  }
  if (kept.empty() && battery.alarm_p() < alarm_rate) kept.push_back(battery.strongest());
  return kept;
}

}  // namespace rangecal::diagnosis
