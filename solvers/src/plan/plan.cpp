// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/plan/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "diagnosis/twins.hpp"
#include "plan/information.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

using Eigen::Vector2d;
constexpr double clearance_m = 0.4, separation_m = 0.3, margin_m = 0.3;
constexpr double alarm_rate = 0.02;

struct Room {
  Vector2d low, high;
  Vector2d at(double u, double v) const {
    return low + Vector2d(u * (high.x() - low.x()), v * (high.y() - low.y()));
  }
};

Room room_of(const Scene& sketch) {
  if (sketch.random_landmarks)
    return {sketch.random_landmarks->box_min_m, sketch.random_landmarks->box_max_m};
  Room room{Vector2d::Constant(1e300), Vector2d::Constant(-1e300)};
  const auto take = [&](const Vector2d& p) {
    room.low = room.low.cwiseMin(p);
    room.high = room.high.cwiseMax(p);
  };
  for (const Stop& stop : sketch.stops) take({stop.commanded.x_m, stop.commanded.y_m});
  for (const Vector2d& position : sketch.positions) take(position);
  return room;
}

/// Place and direction at the share u of a path.
Pose2 on_path(const std::string& path, const Room& room, double u) {
  const bool along_x = room.high.x() - room.low.x() >= room.high.y() - room.low.y();
  const auto place = [&](double a, double b) { return along_x ? room.at(a, b) : room.at(b, a); };
  const auto point = [&](double s) -> Vector2d {
    if (path == "loop")
      return place(0.5 + 0.28 * std::cos(2.0 * std::numbers::pi * s),
                   0.5 + 0.28 * std::sin(2.0 * std::numbers::pi * s));
    if (path == "two legs")
      return s < 0.5 ? place(0.15 + 1.2 * s, 0.35) : place(0.75, 0.35 + 0.9 * (s - 0.5));
    if (path == "diagonal") return place(0.15 + 0.7 * s, 0.15 + 0.7 * s);
    return place(0.1 + 0.8 * s, 0.5);
  };
  const Vector2d p = point(u), step = point(u + 1e-4) - point(u - 1e-4);
  return {p.x(), p.y(), std::atan2(step.y(), step.x())};
}

void lay_stops(const Room& room, int places, PlanDesign& design) {
  design.places = places;
  design.stops.clear();
  for (int k = 0; k < places; ++k) {
    const double last = design.path == "loop" ? places : std::max(1, places - 1);
    for (int t = 0; t < design.headings; ++t) {
      Stop stop;
      stop.label = fmt::format("{}", k * design.headings + t);
      stop.commanded = on_path(design.path, room, k / last);
      stop.commanded.heading_rad = std::remainder(
          stop.commanded.heading_rad + 2.0 * std::numbers::pi * t / design.headings, 2.0 * std::numbers::pi);
      if (design.headings > 1) stop.place = fmt::format("p{}", k);
      design.stops.push_back(stop);
    }
  }
}

double minutes_of(const PlanDesign& design, const PlanCosts& costs) {
  const double places = design.places, turns = places * (design.headings - 1);
  return (places * costs.place_s + turns * costs.turn_s +
          static_cast<double>(design.landmarks.size()) * costs.landmark_s +
          places * design.headings * design.repeats * costs.scan_s) /
         60.0;
}

class Planner {
 public:
  explicit Planner(const PlanRequest& request) : request_(request), room_(room_of(request.sketch)) {
    if (!((room_.high - room_.low).minCoeff() > 2.0 * margin_m))
      throw InputError(fmt::format("plan: the sketch's room is {:.2f} by {:.2f} m, too small to plan in",
                                   room_.high.x() - room_.low.x(), room_.high.y() - room_.low.y()));
  }

  Plan run() {
    Plan plan;
    plan.best.std_dev_m = std::numeric_limits<double>::infinity();
    plan.best.minutes = std::numeric_limits<double>::infinity();
    const PlanDesign first = start("line", 1, 5);
    JointState state;
    const diagnosis::Rows rows = plan::expected_rows(request_, first, false, state);
    if (rows.size() == 0)
      throw InputError("plan: no landmark in the room would be seen from a line through it");
    nuisances_ = plan::nuisances_of(request_, rows);
    std::optional<PlanDesign> line, accurate_line;
    consider_sizes(first, line, accurate_line);
    plan.line = line;
    if (!line && accurate_line) plan.line_std_dev_m = accurate_line->std_dev_m;
    // Ranges alone leave landmarks at either side of a straight path, and those near it anywhere: the bound there promises too much.
    const bool straight = request_.sketch.reads_bearings;
    std::optional<PlanDesign> best, accurate;
    if (straight) best = line, accurate = accurate_line;
    for (const char* path :
         straight ? std::vector{"line", "diagonal", "two legs", "loop"} : std::vector{"two legs", "loop"})
      for (const int headings : {1, 2, 4})
        for (int landmarks = 3; landmarks <= request_.most_landmarks; ++landmarks)
          for (const int places : {5, 12}) {  // what is best for few places need not be for many
            PlanDesign design = start(path, headings, landmarks);
            lay_stops(room_, places, design);
            exchange(design);
            if (std::isfinite(design.std_dev_m)) consider_sizes(design, best, accurate);
          }
    plan.evaluated = evaluated_;
    if (best) {
      plan.outcome = Outcome::converged;
      plan.best = *best;
    } else if (accurate) {
      plan.outcome = Outcome::not_converged;
      plan.best = *accurate;
      plan.reason = fmt::format(
          "no design within {} places, {} landmarks and {} repeats reaches {:.2f} mm; the most accurate reaches {:.2f} mm",
          request_.most_places, request_.most_landmarks, request_.most_repeats, 1e3 * request_.accuracy_m,
          1e3 * accurate->std_dev_m);
    } else {
      plan.reason = "no design sees its landmarks at the distances asked for";
      return plan;
    }
    plan.best = evaluate_design(request_, plan.best);
    if (plan.line) plan.line = evaluate_design(request_, *plan.line);
    return plan;
  }

 private:
  /// Landmarks at both sides in turn, evenly along the room; eight places, five repeats.
  PlanDesign start(const std::string& path, int headings, int landmarks) const {
    PlanDesign design;
    design.path = path;
    design.headings = headings;
    design.repeats = 5;
    lay_stops(room_, 8, design);
    const bool along_x = room_.high.x() - room_.low.x() >= room_.high.y() - room_.low.y();
    for (int l = 0; l < landmarks; ++l) {
      const double a = (l + 0.5) / landmarks, b = l % 2 ? 0.15 : 0.85;
      design.landmarks.push_back(along_x ? room_.at(a, b) : room_.at(b, a));
      design.radius_m.push_back(request_.radii_m[static_cast<std::size_t>(l) % request_.radii_m.size()]);
    }
    return design;
  }

  double criterion(const PlanDesign& design) {
    ++evaluated_;
    return plan::criterion(request_, design, nuisances_);
  }

  bool free(const PlanDesign& design, std::size_t l, const Vector2d& at) const {
    for (const Stop& stop : design.stops)
      if ((at - Vector2d(stop.commanded.x_m, stop.commanded.y_m)).norm() < clearance_m + design.radius_m[l])
        return false;
    for (std::size_t other = 0; other < design.landmarks.size(); ++other)
      if (other != l && (at - design.landmarks[other]).norm() < separation_m) return false;
    return true;
  }

  /// Each landmark in turn to the place of a grid that makes the criterion smallest, until a round changes nothing.
  void exchange(PlanDesign& design) {
    constexpr int columns = 5, rows = 4;
    design.std_dev_m = criterion(design);
    for (int round = 0; round < 2; ++round) {
      bool moved = false;
      for (std::size_t l = 0; l < design.landmarks.size(); ++l)
        for (int i = 0; i < columns * rows; ++i) {
          const int column = i % columns, row = i / columns;
          const Vector2d at = room_.at(0.05 + 0.9 * column / (columns - 1), 0.05 + 0.9 * row / (rows - 1.0));
          if (!free(design, l, at)) continue;
          PlanDesign trial = design;
          trial.landmarks[l] = at;
          const double value = criterion(trial);
          if (value >= (1.0 - 1e-9) * design.std_dev_m) continue;
          design.landmarks[l] = at;
          design.std_dev_m = value;
          moved = true;
        }
      if (!moved) break;
    }
  }

  /// All numbers of places and repeats: the fewest minutes that reach the accuracy, and the best accuracy at all.
  void consider_sizes(const PlanDesign& pattern, std::optional<PlanDesign>& best,
                      std::optional<PlanDesign>& accurate) {
    for (const int places : {4, 5, 6, 8, 10, 12, 16, 20, 28, 40}) {
      if (places > request_.most_places) continue;
      for (const int repeats : {1, 2, 5, 10, 20, 50}) {
        if (repeats > request_.most_repeats) continue;
        PlanDesign design = pattern;
        design.repeats = repeats;
        lay_stops(room_, places, design);
        bool clear = true;
        for (std::size_t l = 0; l < design.landmarks.size(); ++l)
          clear = clear && free(design, l, design.landmarks[l]);
        design.minutes = minutes_of(design, request_.costs);
        if (!clear || (best && design.minutes >= best->minutes)) continue;
        design.std_dev_m = criterion(design);
        if (!std::isfinite(design.std_dev_m)) continue;
        if (!accurate || design.std_dev_m < accurate->std_dev_m) accurate = design;
        if (design.std_dev_m <= request_.accuracy_m) best = design;
      }
    }
  }

  const PlanRequest& request_;
  Room room_;
  std::vector<plan::Nuisance> nuisances_;
  int evaluated_ = 0;
};

}  // namespace

void PlanRequest::check() const {
  const auto refuse = [](const std::string& what) { throw InputError("plan: " + what); };
  if (sketch.kind != RecordingKind::landmarks)
    refuse("the sketch is of kind pairs: there is nothing to plan but how many readings");
  if (!has_sigma(sketch.noise.law)) refuse("the sketch's noise is polynomial; give a power law");
  if (sketch.reads_bearings && !(sketch.sigma_theta_rad > 0.0))
    refuse("the sketch's sigma_theta_rad is not positive; of a sensor that reads no bearings it is 'none'");
  if (!(accuracy_m > 0.0) || !std::isfinite(accuracy_m))
    refuse(fmt::format("accuracy_m = {} is not a positive length", accuracy_m));
  if (!(low_m > 0.0 && high_m > low_m && std::isfinite(high_m)))
    refuse(fmt::format("low_m = {}, high_m = {}: not 0 < low < high", low_m, high_m));
  if (radii_m.empty()) refuse("no radius of a landmark is given");
  for (const double radius : radii_m)
    if (!(radius >= 0.0 && radius < 1.0)) refuse(fmt::format("radius {} m is outside of 0 to 1", radius));
  for (const double cost : {costs.place_s, costs.turn_s, costs.landmark_s, costs.scan_s})
    if (!(cost >= 0.0) || !std::isfinite(cost)) refuse(fmt::format("a cost is {} s", cost));
  if (std::set<std::string>(effects.begin(), effects.end()).size() < effects.size())
    refuse("an effect is named twice");
  if (most_places < 4 || most_landmarks < 3 || most_repeats < 1)
    refuse("fewer than 4 places, 3 landmarks or 1 repeat are allowed");
}

Plan plan_experiment(const PlanRequest& request) {
  request.check();
  return Planner(request).run();
}

Scene planned_scene(const PlanRequest& request, const PlanDesign& design) {
  Scene scene = request.sketch;
  scene.stops = design.stops;
  scene.random_landmarks.reset();
  scene.tapes.clear();
  scene.landmarks.clear();
  scene.positions = design.landmarks;
  for (std::size_t l = 0; l < design.landmarks.size(); ++l)
    scene.landmarks.push_back({fmt::format("L{}", l), design.radius_m[l], std::nullopt});
  scene.repeats = design.repeats;
  return scene;
}

PlanDesign evaluate_design(const PlanRequest& request, PlanDesign design) {
  JointState state;
  const diagnosis::Rows rows = plan::expected_rows(request, design, true, state);
  design.minutes = minutes_of(design, request.costs);
  design.std_dev_m = plan::criterion(request, design, plan::nuisances_of(request, rows));
  design.effects.clear();
  if (request.effects.empty()) return design;
  const diagnosis::Space space(rows, {}, state);
  const double limit =
      diagnosis::detection_threshold(alarm_rate, static_cast<double>(request.effects.size()));
  for (const std::string& id : request.effects) {
    const auto typical = diagnosis::typical_effect(space, *find_effect(id));
    if (!typical) continue;
    PlanEffect effect{id, typical->noncentrality >= limit, typical->noncentrality,
                      diagnosis::range_error_of(space, *typical)};
    design.effects.push_back(effect);
  }
  return design;
}

}  // namespace rangecal
