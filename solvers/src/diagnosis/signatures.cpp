// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/signatures.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "rangecal/problems/effects/reading_chain.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double absorbed_share = 1e-9;

void scale(double factor, Space::Direction& d) {
  d.mean.scale(factor);
  d.projected *= factor;
  d.range_variance *= factor;
  d.bearing_variance *= factor;
}

}  // namespace

Space::Space(const Rows& rows, const Model& model, const JointState& state)
    : rows_(rows),
      model_(model),
      geometry_(cell_geometry(rows, state)),
      working_(working_problem(rows, model, state)),
      projector_(rows, working_, state) {
  std::vector<Direction> active;
  for (const ActiveEffect& effect : model)
    for (int j = 0; j < static_cast<int>(effect.parameters.size()); ++j) {
      if (effect.effect->info().parameters[static_cast<std::size_t>(j)].discrete) continue;
      Direction d = slope(effect, j);
      const double before = d.raw;
      for (const Direction& unit : active) take_out(d, unit);
      d.information = inner(d, d);
      if (!(d.information > absorbed_share * before) || d.information <= 0.0) continue;
      scale(1.0 / std::sqrt(d.information), d);
      active.push_back(std::move(d));
    }
  active_ = std::move(active);
}

/// Changes of the readings, means and log variances, as signatures; nearly all effects are alike for all
/// repeats.
struct Space::Changes {
  Signature mean;
  Eigen::VectorXd range_variance, bearing_variance;
};

Space::Changes Space::changes(const Model& unordered) const {
  const Model model = in_order_of_stages(unordered);
  const Rows& rows = rows_;
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  const auto at = [&](int i) {
    ReadingChain chain;
    const ReadingView<double> view = view_of(rows, geometry_, static_cast<std::size_t>(i));
    for (const ActiveEffect& active : model) {
      if (muted_from_ >= 0 && view.stop >= muted_from_ && muted_.count(active.effect->info().id)) continue;
      chain.add(*active.effect, active.parameters.data(), view);
    }
    return chain.sum();
  };
  const auto same = [](const ReadingChange<double>& a, const ReadingChange<double>& b) {
    return std::abs(a.range - b.range) + std::abs(a.bearing - b.bearing) +
               std::abs(a.range_log_variance - b.range_log_variance) +
               std::abs(a.bearing_log_variance - b.bearing_log_variance) <
           1e-12;
  };
  Changes result;
  result.mean.range = result.mean.bearing = Eigen::VectorXd::Zero(rows.cell_count);
  Eigen::VectorXd range_variance = Eigen::VectorXd::Zero(rows.cell_count), bearing_variance = range_variance;
  bool varies = false;
  for (int c = 0; c < rows.cell_count && !varies; ++c) {
    const int first = rows.cell_begin[c], last = rows.cell_begin[c + 1] - 1;
    const ReadingChange<double> one = at(first);
    result.mean.range[c] = one.range;
    result.mean.bearing[c] = one.bearing;
    range_variance[c] = one.range_log_variance;
    bearing_variance[c] = one.bearing_log_variance;
    varies = last > first && (!same(one, at(first + 1)) || !same(one, at(last)));
  }
  Eigen::VectorXd range_rows(n), bearing_rows(n);
  if (varies) {
    Eigen::VectorXd range(n), bearing(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const ReadingChange<double> one = at(static_cast<int>(i));
      range[i] = one.range;
      bearing[i] = one.bearing;
      range_rows[i] = one.range_log_variance;
      bearing_rows[i] = one.bearing_log_variance;
    }
    result.mean = projector_.of_rows(range, bearing);
  } else if (range_variance.squaredNorm() + bearing_variance.squaredNorm() > 0.0) {
    for (Eigen::Index i = 0; i < n; ++i) {
      range_rows[i] = range_variance[rows.cell[i]];
      bearing_rows[i] = bearing_variance[rows.cell[i]];
    }
  } else {
    range_rows.setZero();
    bearing_rows.setZero();
  }
  if (range_rows.squaredNorm() + bearing_rows.squaredNorm() > 0.0) {
    result.range_variance = std::move(range_rows);
    result.bearing_variance = std::move(bearing_rows);
  }
  add_stop_changes(rows_, projector_, model, result.mean);
  return result;
}

double Space::inner(const Direction& a, const Direction& b) const {
  double sum = projector_.inner(a.mean, b.projected, b.mean);
  if (a.range_variance.size() > 0 && b.range_variance.size() > 0)
    sum += 0.5 * (a.range_variance.dot(b.range_variance) + a.bearing_variance.dot(b.bearing_variance));
  return sum;
}

void Space::take_out(Direction& a, const Direction& unit) const {
  const double share = inner(a, unit);
  a.mean.range -= share * unit.mean.range;
  a.mean.bearing -= share * unit.mean.bearing;
  if (unit.mean.within()) {
    if (!a.mean.within()) {
      a.mean.range_rows = Eigen::VectorXd::Zero(unit.mean.range_rows.size());
      a.mean.bearing_rows = a.mean.range_rows;
    }
    a.mean.range_rows -= share * unit.mean.range_rows;
    a.mean.bearing_rows -= share * unit.mean.bearing_rows;
  }
  if (unit.range_variance.size() > 0) {
    if (a.range_variance.size() == 0)
      a.range_variance = a.bearing_variance = Eigen::VectorXd::Zero(unit.range_variance.size());
    a.range_variance -= share * unit.range_variance;
    a.bearing_variance -= share * unit.bearing_variance;
  }
  a.projected -= share * unit.projected;
}

Space::Direction Space::finish(Signature mean, Eigen::VectorXd range_variance,
                               Eigen::VectorXd bearing_variance) const {
  Direction d;
  d.mean = std::move(mean);
  d.raw = projector_.raw_information(d.mean);
  d.projected = projector_.project(d.mean);
  if (range_variance.size() > 0) {
    range_variance.array() -= range_variance.mean();
    bearing_variance.array() -= bearing_variance.mean();
    if (!rows_.reads_bearings()) bearing_variance.setZero();
    d.range_variance = std::move(range_variance);
    d.bearing_variance = std::move(bearing_variance);
  }
  for (const Direction& unit : active_) take_out(d, unit);
  d.information = std::max(0.0, inner(d, d));
  return d;
}

Space::Direction Space::of_signature(Signature mean) const { return finish(std::move(mean), {}, {}); }

void Space::mute(std::set<std::string> ids, int first_stop) {
  muted_ = std::move(ids);
  muted_from_ = first_stop;
}

Space::Direction Space::change(const Model& model) const {
  Changes one = changes(model);
  return finish(std::move(one.mean), std::move(one.range_variance), std::move(one.bearing_variance));
}

Space::Direction Space::difference(const Model& up, const Model& down, double factor) const {
  Changes high = changes(up);
  const Changes low = changes(down);
  const auto subtract = [factor](Eigen::VectorXd& a, const Eigen::VectorXd& b) {
    if (a.size() == 0) a = Eigen::VectorXd::Zero(b.size());
    if (b.size() > 0) a -= b;
    a *= factor;
  };
  subtract(high.mean.range, low.mean.range);
  subtract(high.mean.bearing, low.mean.bearing);
  subtract(high.mean.range_rows, low.mean.range_rows);
  subtract(high.mean.bearing_rows, low.mean.bearing_rows);
  subtract(high.range_variance, low.range_variance);
  subtract(high.bearing_variance, low.bearing_variance);
  return finish(std::move(high.mean), std::move(high.range_variance), std::move(high.bearing_variance));
}

Space::Direction Space::slope(const ActiveEffect& active, int index) const {
  Eigen::VectorXd range, bearing;
  variance_signature(rows_, geometry_, active, index, range, bearing);
  if (range.squaredNorm() + bearing.squaredNorm() == 0.0) range.resize(0), bearing.resize(0);
  return finish(effect_signature(rows_, projector_, active, index), std::move(range), std::move(bearing));
}

double Space::left(Direction a, std::vector<Direction> span) const {
  std::vector<Direction> units;
  for (Direction& d : span) {
    const double before = inner(d, d);
    for (const Direction& unit : units) take_out(d, unit);
    const double information = inner(d, d);
    if (!(information > 1e-6 * before) || !(information > 0.0)) continue;
    scale(1.0 / std::sqrt(information), d);
    units.push_back(std::move(d));
  }
  for (const Direction& unit : units) take_out(a, unit);
  return std::max(0.0, inner(a, a));
}

}  // namespace rangecal::diagnosis
