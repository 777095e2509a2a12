// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/twins.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "rangecal/core/distributions.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double invisible = 4.0;       ///< noncentrality at the typical size below which nothing shows
constexpr double absorbed_part = 3e-3;  ///< of the information
constexpr double twin_cosine = 0.999;
constexpr double named_share = 0.2;
constexpr double little = 0.05;  ///< of the information: what goes on within the stops

double two_sided_limit(double rate, double questions) {
  const double each = -std::expm1(std::log1p(-rate) / std::max(1.0, questions));
  return -normal_quantile(0.5 * each);
}

bool absorbed(const TypicalEffect& typical) {
  const Space::Direction& d = typical.direction;
  return d.raw > 25.0 && typical.noncentrality < invisible && d.information < absorbed_part * d.raw;
}

/// The calibration's unknowns that take more than a fifth of what x does to the readings (in noise-weighted
/// norm).
std::vector<std::string> takers(const Space& space, const Signature& x) {
  const Projector& projector = space.projector();
  const JointLayout& layout = projector.system().layout();
  const Cells& c = space.rows().problem.cells;
  const CellGeometry& g = projector.geometry();
  Eigen::VectorXd phi, stops;
  projector.absorbed(x, phi, stops);
  const double whole = std::sqrt(projector.raw_information(x));
  std::vector<std::string> names;
  const auto add = [&](const std::string& name, const Signature& part) {
    if (std::sqrt(projector.raw_information(part)) > named_share * whole) names.push_back(name);
  };
  Signature part;
  part.bearing = Eigen::VectorXd::Zero(projector.cells());
  part.range = Eigen::VectorXd::Constant(projector.cells(), 1.0);
  for (int a = 0; a < layout.alpha_count; ++a) {
    Signature power = part;
    power.range *= phi[a];
    add("alpha_" + std::to_string(a), power);
    for (int i = 0; i < projector.cells(); ++i) part.range[i] *= g.u[static_cast<std::size_t>(i)];
  }
  if (space.rows().pairs) return names;
  std::vector<Eigen::Vector3d> moved(static_cast<std::size_t>(space.rows().problem.stop_count()),
                                     Eigen::Vector3d::Zero());
  for (std::size_t k = 0; k < moved.size(); ++k) {
    const JointLayout::Node& node = layout.nodes[static_cast<std::size_t>(layout.node_of_stop[k])];
    if (node.free_position) moved[k].head<2>() = stops.segment<2>(static_cast<Eigen::Index>(node.coordinate));
    const int heading = node.heading[static_cast<std::size_t>(layout.slot_of_stop[k])];
    if (heading >= 0) moved[k][2] = stops[static_cast<Eigen::Index>(node.coordinate) + heading];
  }
  add("stops", projector.of_stops(moved));
  for (int i = 0; i < projector.cells(); ++i) {
    const std::size_t cell = static_cast<std::size_t>(i);
    const Eigen::Vector2d shift = phi.segment<2>(layout.landmark_begin + 2 * c.landmark[cell]);
    part.range[i] = g.slope[cell] * g.n[cell].dot(shift);
    part.bearing[i] = g.t[cell].dot(shift) / g.axis_distance[cell];
  }
  add("landmarks", part);
  return names;
}

}  // namespace

double detection_threshold(double rate, double questions) {
  return std::pow(two_sided_limit(rate, questions) + normal_quantile(0.8), 2);
}

double detection_power(double noncentrality, double rate, double questions) {
  const double limit = two_sided_limit(rate, questions), shift = std::sqrt(std::max(0.0, noncentrality));
  return normal_below(shift - limit) + normal_below(-shift - limit);
}

std::vector<std::vector<std::string>> find_twins(const Space& space,
                                                 const std::vector<TypicalEffect>& effects) {
  struct Entry {
    std::string name;
    Space::Direction direction;
    bool absorbed = false, of_stops = false;
  };
  std::vector<Entry> entries;
  if (!space.rows().pairs) {
    const std::vector<Eigen::Vector3d> turned(static_cast<std::size_t>(space.rows().problem.stop_count()),
                                              Eigen::Vector3d(0.0, 0.0, 0.01));
    entries.push_back({"heading_zero", space.of_signature(space.projector().of_stops(turned)), false, true});
  }
  for (const TypicalEffect& typical : effects)
    if (typical.direction.raw > 0.0 && typical.direction.range_variance.size() == 0)
      entries.push_back({typical.active.effect->info().id, typical.direction, absorbed(typical),
                         typical.active.effect->acts_on_stops()});
  // Groups of collinear signatures: compared as they stand where both are absorbed, else by what is left of
  // them.
  std::vector<std::size_t> group(entries.size());
  std::iota(group.begin(), group.end(), std::size_t{0});
  const auto raw_inner = [&](const Signature& a, const Signature& b) {
    return space.projector().raw_inner(a, b);
  };
  for (std::size_t a = 0; a < entries.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) {
      Space::Direction x = entries[a].direction, y = entries[b].direction;
      // A stop is modelled as at rest: what little goes on within it, a drift during the stay, tells nothing.
      const auto is_little = [&](const Signature& whole) {
        Signature means = whole;
        means.range_rows.resize(0);
        means.bearing_rows.resize(0);
        return raw_inner(whole, whole) - raw_inner(means, means) < little * raw_inner(whole, whole);
      };
      if (entries[a].of_stops != entries[b].of_stops && is_little(x.mean) && is_little(y.mean)) {
        for (Space::Direction* d : {&x, &y}) {
          d->mean.range_rows.resize(0);
          d->mean.bearing_rows.resize(0);
          d->information = std::max(0.0, space.inner(*d, *d));
        }
      }
      const double raw_x = raw_inner(x.mean, x.mean), raw_y = raw_inner(y.mean, y.mean);
      double cosine = std::abs(raw_inner(x.mean, y.mean)) / std::sqrt(std::max(1e-300, raw_x * raw_y));
      const bool either_absorbed = entries[a].absorbed || entries[b].absorbed;
      if (!either_absorbed && x.information > 1e-3 && y.information > 1e-3)
        cosine = std::max(cosine > 1.0 - 1e-6 ? 1.0 : 0.0,
                          std::abs(space.inner(x, y)) / std::sqrt(x.information * y.information));
      else if (either_absorbed && !(entries[a].absorbed && entries[b].absorbed))
        cosine = 0.0;
      if (cosine <= (either_absorbed ? 1.0 - 1e-6 : twin_cosine)) continue;
      const std::size_t from = group[a], to = group[b];
      for (std::size_t& g : group)
        if (g == from) g = to;
    }
  std::vector<std::vector<std::string>> sets;
  for (std::size_t g = 0; g < entries.size(); ++g) {
    std::vector<std::string> set;
    const Entry* taken = nullptr;
    for (std::size_t a = 0; a < entries.size(); ++a) {
      if (group[a] != g) continue;
      set.push_back(entries[a].name);
      if (entries[a].absorbed) taken = &entries[a];
    }
    if (taken)
      for (const std::string& name : takers(space, taken->direction.mean)) set.push_back(name);
    if (set.size() < 2) continue;
    if (set.front() == "heading_zero") std::rotate(set.begin(), set.begin() + 1, set.end());
    sets.push_back(std::move(set));
  }
  return sets;
}

}  // namespace rangecal::diagnosis
