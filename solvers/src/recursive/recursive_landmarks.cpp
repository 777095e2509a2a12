// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "closed_form/stop_variance.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/solvers/statistics/median.hpp"
#include "recursive/count_up.hpp"
#include "recursive/landmark_sums.hpp"
#include "recursive/predicted_reading.hpp"
#include "recursive/residual_sketch.hpp"

namespace rangecal {
namespace {

constexpr double largest_length_m = 1e6;  ///< of a pose or a reading: its square would end every sum

}  // namespace

void RecursiveLandmarksOptions::check() const {
  const auto refuse = [](const std::string& what) { throw InputError("RecursiveLandmarksOptions: " + what); };
  if (order && (*order < 0 || *order > 6)) refuse(fmt::format("order = {} is outside of 0 .. 6", *order));
  if (max_order < 1 || max_order > 6) refuse(fmt::format("max_order = {} is outside of 1 .. 6", max_order));
  if (!has_sigma(law)) refuse("law = polynomial is not one that can be tracked");
  if (!(sigma_xy_m >= 0.0 && std::isfinite(sigma_xy_m)))
    refuse(fmt::format("sigma_xy_m = {} is negative or not finite", sigma_xy_m));
  if (!(sigma_heading_rad >= 0.0 && std::isfinite(sigma_heading_rad)))
    refuse(fmt::format("sigma_heading_rad = {} is negative or not finite", sigma_heading_rad));
  if (!(sigma_theta_rad > 0.0 && std::isfinite(sigma_theta_rad)))
    refuse(fmt::format("sigma_theta_rad = {} is not positive", sigma_theta_rad));
  if (!(forget > 0.0)) refuse(fmt::format("forget = {} is not a positive time constant", forget));
  if (random_walk && std::isfinite(forget))
    refuse(
        "forget: along a random_walk the first stop tells where the landmarks are and cannot be forgotten");
  if (block < 8 || block > 10000) refuse(fmt::format("block = {} is outside of 8 .. 10000", block));
}

RecursiveLandmarks::RecursiveLandmarks(const RecursiveLandmarksOptions& options)
    : options_((options.check(), options)),
      range_residuals_(std::make_unique<ResidualSketch>()),
      bearing_residuals_(std::make_unique<ResidualSketch>()) {
  clear_held();
}
RecursiveLandmarks::~RecursiveLandmarks() = default;
RecursiveLandmarks::RecursiveLandmarks(RecursiveLandmarks&&) noexcept = default;
RecursiveLandmarks& RecursiveLandmarks::operator=(RecursiveLandmarks&&) noexcept = default;

void RecursiveLandmarks::clear_held() {
  const std::vector<double> radii = std::move(held_.landmark_radius_m);
  held_ = JointProblem{};
  held_.landmark_radius_m = radii;
  held_.landmark_recording.assign(radii.size(), 0);
  held_.rows_alike = looks_for_outliers();
  held_.cells.stop_begin = {0};
  held_labels_.clear();
  held_places_.clear();
  anchored_ = false;
  tried_at_ = 0;
}

/// After sums that end in a stop of a random walk: it is the first of those held, with no reading of its own.
void RecursiveLandmarks::hold_last_pose() {
  const std::string label = held_labels_.back(), place = held_places_.back();
  StopPrior prior;  // its law is that of LastPose, wherever it is expanded
  prior.commanded = held_.stops.back().commanded;
  prior.sigma_xy_m = sums_->last_pose->free_position ? 1.0 : 0.0;
  prior.sigma_heading_rad = sums_->last_pose->free_heading ? 1.0 : 0.0;
  clear_held();
  hold(label, prior, &place);
  anchored_ = true;
}

StopPrior RecursiveLandmarks::prior_of(const Stop& stop) const {
  for (const double value : {stop.commanded.x_m, stop.commanded.y_m, stop.commanded.heading_rad})
    if (!(std::abs(value) <= largest_length_m))
      throw InputError(
          fmt::format("stop '{}': its pose is not finite, or beyond {:g} m", stop.label, largest_length_m));
  StopPrior prior;
  prior.commanded = stop.commanded;
  if (stop.covariance) {
    set_covariance(checked_covariance(stop, "stop '" + stop.label + "'"), prior);
    return prior;
  }
  prior.sigma_xy_m = stop.sigma_xy_m.value_or(options_.sigma_xy_m);
  prior.sigma_heading_rad = stop.sigma_heading_rad.value_or(options_.sigma_heading_rad);
  for (const double value : {prior.sigma_xy_m, prior.sigma_heading_rad})
    if (!(value >= 0.0 && std::isfinite(value)))
      throw InputError("stop '" + stop.label + "': its accuracy is negative or not finite");
  return prior;
}

void RecursiveLandmarks::open_stop(const Stop& stop) {
  StopPrior prior = prior_of(stop);
  if (std::find(held_labels_.begin(), held_labels_.end(), stop.label) != held_labels_.end())
    throw InputError("stop '" + stop.label +
                     "' comes back after others; the readings of a stop follow each other");
  // a turn that went wrong moves what comes after, which an exact position cannot follow
  if (options_.random_walk && !held_labels_.empty() && prior.sigma_xy_m == 0.0 &&
      prior.sigma_heading_rad > 0.0 && (stop.place.empty() || held_places_.back() != stop.place))
    throw InputError(
        "stop '" + stop.label +
        "': a step of a random walk has an exact length but no exact heading; give it a sigma_xy_m");
  add_latest_lines(bearings_);
  const bool same_place = !stop.place.empty() && !held_places_.empty() && held_places_.back() == stop.place;
  if (same_place) {
    require_turn_alone(stop, "stop '" + stop.label + "'");
    prior.shape.reset();
  } else if (options_.random_walk && !stop.place.empty() &&
             std::find(held_places_.begin(), held_places_.end(), stop.place) != held_places_.end()) {
    throw InputError("stop '" + stop.label + "' returns to place '" + stop.place +
                     "', which a random walk cannot do");
  }
  // where they could not be summed up a new try has to wait for some more
  if (constexpr int between = 8; !same_place && own_stops() >= options_.block &&
                                 own_stops() >= tried_at_ + (tried_at_ > 0 ? between : 0))
    sum_up();
  prior.chained = options_.random_walk && !held_labels_.empty();
  prior.opens_place = !same_place;
  if (prior.chained) {
    walked_ = after_step(walked_, prior, prior.sigma_xy_m, held_.stops.back().commanded.heading_rad);
  } else if (options_.random_walk) {
    walked_ = first_covariance_ = covariance_of(prior, prior.sigma_xy_m);
    first_position_m_ = {prior.commanded.x_m, prior.commanded.y_m};
  }
  hold(stop.label, prior, same_place ? nullptr : &stop.place);
  ++stops_;
}

void RecursiveLandmarks::pass(const Stop& stop) {
  if (!options_.random_walk || (!held_labels_.empty() && held_labels_.back() == stop.label)) return;
  open_stop(stop);
}

void RecursiveLandmarks::hold(const std::string& label, StopPrior prior, const std::string* new_place) {
  if (new_place) held_places_.push_back(*new_place);
  prior.place = static_cast<int>(held_places_.size()) - 1;
  prior.opens_place = new_place != nullptr;
  held_.place_count = prior.place + 1;
  held_.stops.push_back(prior);
  held_.sigma_s_shared.push_back(0);
  held_.cells.stop_begin.push_back(held_.cells.stop_begin.back());
  held_labels_.push_back(label);
}

int RecursiveLandmarks::landmark_of(const LandmarkReading& reading) {
  const auto found = std::find(labels_.begin(), labels_.end(), reading.landmark);
  if (found != labels_.end()) return static_cast<int>(found - labels_.begin());
  labels_.push_back(reading.landmark);
  bearings_.emplace_back();
  held_.landmark_radius_m.push_back(reading.radius_m);
  held_.landmark_recording.push_back(0);
  return static_cast<int>(labels_.size()) - 1;
}

std::size_t RecursiveLandmarks::new_cell(std::size_t at, int landmark) {
  Cells& c = held_.cells;
  const auto place = static_cast<std::ptrdiff_t>(at);
  c.stop.insert(c.stop.begin() + place, held_.stop_count() - 1);
  c.landmark.insert(c.landmark.begin() + place, landmark);
  c.radius_m.insert(c.radius_m.begin() + place, held_.landmark_radius_m[static_cast<std::size_t>(landmark)]);
  for (auto* column : {&c.count, &c.range_weight, &c.bearing_weight, &c.range_mean, &c.range_mean_square,
                       &c.bearing_mean, &c.bearing_mean_square})
    column->insert(column->begin() + place, 0.0);
  ++c.stop_begin.back();
  return at;
}

std::size_t RecursiveLandmarks::cell_of(int landmark) {
  const Cells& c = held_.cells;
  for (std::size_t i = static_cast<std::size_t>(c.stop_begin.end()[-2]); i < c.size(); ++i)
    if (c.landmark[i] == landmark) return i;
  return new_cell(c.size(), landmark);
}

/// The row of the latest stop that a reading is alike, else a new one behind the landmark's others.
std::size_t RecursiveLandmarks::row_of(int landmark, double range_m, double bearing_rad) {
  constexpr std::size_t apart = 64;  // rows of a landmark before any are put together
  constexpr double alike = 0.25, of_normal = 1.0 / median_of_normal_size;
  const Cells& c = held_.cells;
  std::size_t begin = static_cast<std::size_t>(c.stop_begin.end()[-2]);
  while (begin < c.size() && c.landmark[begin] != landmark) ++begin;
  std::size_t end = begin;
  while (end < c.size() && c.landmark[end] == landmark) ++end;
  if (end - begin < apart) return new_cell(end, landmark);
  // About the median of the first rows, in their spread and the farther off the wider.
  const auto row = static_cast<std::ptrdiff_t>(begin), last = static_cast<std::ptrdiff_t>(begin + apart);
  const auto reach = [&](const std::vector<double>& values, double value) {
    std::vector<double> first(values.begin() + row, values.begin() + last);
    const double middle = upper_median(first);
    for (double& one : first) one = std::abs(one - middle);
    return alike * std::max(of_normal * upper_median(std::move(first)), std::abs(value - middle));
  };
  const double range_reach = reach(c.range_mean, range_m), bearing_reach = reach(c.bearing_mean, bearing_rad);
  std::size_t nearest = end;
  double least = 1.0;
  for (std::size_t i = begin; i < end; ++i) {
    const double off =
        std::max(std::abs(c.range_mean[i] - range_m) / std::max(range_reach, 1e-300),
                 std::abs(wrap_angle(c.bearing_mean[i] - bearing_rad)) / std::max(bearing_reach, 1e-300));
    if (!(off < least)) continue;
    least = off;
    nearest = i;
  }
  return nearest < end ? nearest : new_cell(end, landmark);
}

bool RecursiveLandmarks::add(const LandmarkReading& reading) {
  const double range = reading.range_m, bearing = reading.bearing_rad;
  const char* reason = std::isnan(range) || std::isnan(bearing)           ? "missing"
                       : !std::isfinite(range) || !std::isfinite(bearing) ? "not finite"
                       : range == 0.0                                     ? "zero"
                       : range < 0.0                                      ? "negative"
                       : range > largest_length_m                         ? "beyond any distance tracked"
                                                                          : nullptr;
  if (reason) {
    drop(reason);
    return false;
  }
  count_up(counts_.read);
  if (!(reading.radius_m >= 0.0 && std::isfinite(reading.radius_m)))
    throw InputError("landmark '" + reading.landmark + "': its radius is negative or not finite");
  if (held_labels_.empty() || held_labels_.back() != reading.stop.label) open_stop(reading.stop);
  const int landmark = landmark_of(reading);
  const std::size_t cell = looks_for_outliers() ? row_of(landmark, range, bearing) : cell_of(landmark);
  Cells& c = held_.cells;
  const double count = c.count[cell] + 1.0;
  const double from_range = range - c.range_mean[cell];
  const double turn = count == 1.0 ? 0.0 : wrap_angle(bearing - c.bearing_mean[cell]);
  // the mean and the mean square deviation as the count grows (Welford 1962)
  c.range_mean[cell] += from_range / count;
  c.range_mean_square[cell] +=
      (from_range * (range - c.range_mean[cell]) - c.range_mean_square[cell]) / count;
  c.bearing_mean[cell] = count == 1.0 ? wrap_angle(bearing) : wrap_angle(c.bearing_mean[cell] + turn / count);
  c.bearing_mean_square[cell] += (turn * turn * (1.0 - 1.0 / count) - c.bearing_mean_square[cell]) / count;
  c.count[cell] = c.range_weight[cell] = c.bearing_weight[cell] = count;
  held_.readings += 1.0;
  ++used_;
  count_up(counts_.used);
  return true;
}

void RecursiveLandmarks::drop(const std::string& reason) {
  count_up(counts_.read);
  count_up(counts_.dropped[reason]);
}

void RecursiveLandmarks::add_latest_lines(std::vector<RecursiveBearings>& bearings) const {
  if (held_labels_.empty()) return;
  JointProblem merged;
  if (looks_for_outliers()) merged = merge_rows(held_);
  const Cells& c = looks_for_outliers() ? merged.cells : held_.cells;
  for (std::size_t cell = static_cast<std::size_t>(c.stop_begin.end()[-2]); cell < c.size(); ++cell)
    bearings[static_cast<std::size_t>(c.landmark[cell])].add(line_of(c, cell));
}

RecursiveBearings::Line RecursiveLandmarks::line_of(const Cells& c, std::size_t cell) const {
  const StopPrior& stop = held_.stops[static_cast<std::size_t>(c.stop[cell])];
  const double phi = stop.commanded.heading_rad + c.bearing_mean[cell],
               d = c.range_mean[cell] + c.radius_m[cell];
  double sigma_s = stop.sigma_xy_m, sigma_heading = stop.sigma_heading_rad;
  if (stop.shape || options_.random_walk) {  // what the stop moves the line by, its turn included
    const StopVariance variance{options_.random_walk ? walked_ : covariance_of(stop, stop.sigma_xy_m)};
    sigma_s = std::sqrt(variance.off_line({std::sin(phi), -std::cos(phi)}, d));
    sigma_heading = 0.0;
  }
  return {{stop.commanded.x_m, stop.commanded.y_m},
          phi,
          d,
          c.count[cell],
          sigma_s,
          sigma_heading,
          options_.sigma_theta_rad};
}

std::vector<LandmarkFromBearings> RecursiveLandmarks::from_bearings() const {
  std::vector<RecursiveBearings> all = bearings_;
  add_latest_lines(all);
  std::vector<LandmarkFromBearings> landmarks;
  for (const RecursiveBearings& one : all) landmarks.push_back(one.landmark());
  return landmarks;
}

std::optional<double> RecursiveLandmarks::outlier_probability(const LandmarkReading& reading) const {
  if (!last_ || options_.random_walk) return std::nullopt;
  const auto known =
      static_cast<std::size_t>(std::find(labels_.begin(), labels_.end(), reading.landmark) - labels_.begin());
  if (known >= last_->landmarks.size()) return std::nullopt;
  if (!shapes_) return 0.0;
  const StopPrior prior = prior_of(reading.stop);
  const auto predicted = predicted_reading(*last_, prior.commanded, {covariance_of(prior, prior.sigma_xy_m)},
                                           last_->landmarks[known], held_.landmark_radius_m[known],
                                           reading.range_m, reading.bearing_rad);
  if (!predicted) return std::nullopt;
  return 1.0 - (1.0 - predicted->range.outlier_probability(shapes_->range)) *
                   (1.0 - predicted->bearing.outlier_probability(shapes_->bearing));
}

double RecursiveLandmarks::effective_stops() const {
  const double w = sum_w_ + own_stops(), w_sq = sum_w_sq_ + own_stops();
  return w_sq > 0.0 ? w * w / w_sq : 0.0;
}

}  // namespace rangecal
