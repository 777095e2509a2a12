// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <cmath>
#include <memory>

#include "json_states.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"
#include "recursive/landmark_answer.hpp"
#include "recursive/residual_sketch.hpp"

namespace rangecal {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

}  // namespace

struct SavedLandmark {
  std::string label;
  double radius_m = 0.0;
  std::array<double, RecursiveBearings::state_size> bearings{};
};

static void fields(JsonFields& json, SavedLandmark& landmark) {
  json.required("label", landmark.label);
  json.required("radius_m", landmark.radius_m);
  json.check(landmark.radius_m >= 0.0, "radius_m", "is negative");
  json.required("bearings", landmark.bearings);
}

struct SavedStop {
  StopPrior prior;
  int cells = 0;  ///< the next so many of the list
};
struct HeldStop : SavedStop {
  std::string label, place;
};

static void prior_fields(JsonFields& json, StopPrior& prior) {
  pose_field(json, "pose", prior.commanded);
  json.required("sigma", std::tie(prior.sigma_xy_m, prior.sigma_heading_rad));
  json.check(prior.sigma_xy_m >= 0.0 && prior.sigma_heading_rad >= 0.0, "sigma", "is negative");
  std::optional<VectorXd> shape;
  if (prior.shape) shape = prior.shape->reshaped();
  json.optional("shape", shape);  // states of 0.1.0 do not know it
  if (json.writing() || !shape) return;
  json.check(shape->size() == 9 && shape->allFinite(), "shape", "is not 9 finite numbers");
  const Eigen::Matrix3d Q = shape->reshaped(3, 3);
  json.check(stop_covariance(covariance_entries(Q), 0.0).fault.empty(), "shape", "is that of no covariance");
  prior.shape = std::make_shared<const Eigen::Matrix3d>(Q);
}

static void fields(JsonFields& json, SavedStop& stop) {
  prior_fields(json, stop.prior);
  json.required("opens_place", stop.prior.opens_place);
  json.whole("cells", stop.cells);
}

static void fields(JsonFields& json, HeldStop& stop) {
  json.required("label", stop.label);
  prior_fields(json, stop.prior);
  json.required("place", stop.place);
  json.required("opens_place", stop.prior.opens_place);
  json.whole("cells", stop.cells);
}

namespace {

struct SketchCell {
  int z = 0, s = 0;  ///< intervals
  std::array<double, 4> sums{};
};

void fields(JsonFields& json, SketchCell& cell) {
  json.row(cell.z, cell.s, cell.sums);
  json.check(std::abs(cell.z) <= 100000 && std::abs(cell.s) <= 100000, "is of no interval");
  json.check(cell.sums[0] > 0.0 && cell.sums[3] > 0.0, "holds what no readings make");
}

void residuals_field(JsonFields& json, const std::string& name, ResidualSketch& sketch) {
  std::vector<SketchCell> cells;
  for (const auto& [place, sums] : sketch.cells) cells.push_back({place.first, place.second, sums});
  json.required(name, cells);
  if (json.reading())
    for (const SketchCell& cell : cells) sketch.cells[{cell.z, cell.s}] = cell.sums;
}

/// A square matrix in one list; empty where there is none.
void gap_field(JsonFields& json, const std::string& name, MatrixXd& gap) {
  VectorXd list = gap.reshaped();
  json.numbers(name, list);
  if (json.writing()) return;
  const Index size = std::lround(std::sqrt(static_cast<double>(list.size())));
  json.check(size * size == list.size(), name, "is not square");
  gap = list.reshaped(size, size);
}

/// About so many unknowns.
void last_pose_fields(JsonFields& json, LastPose& law, Index phis) {
  json.required("free", std::tie(law.free_position, law.free_heading));
  pose_field(json, "pose", law.exact);
  const Index dim = law.dim();
  const auto count = static_cast<std::size_t>(phis);
  lists_field(json, "mean", law.mean, SigmaGrid::nodes, dim);
  lists_field(json, "slope", law.slope, SigmaGrid::nodes, dim, phis);
  lists_field(json, "covariance", law.covariance, SigmaGrid::nodes, dim, dim);
  lists_field(json, "bend", law.bend, count, dim, dim);
  lists_field(json, "turn", law.turn, count, dim, phis);
}

/// No cell that readings do not make.
void check_readings(const JsonFields& json, const Cells& c) {
  const std::size_t size = c.landmark.size();
  for (const std::vector<double>* column :
       {&c.count, &c.range_mean, &c.range_mean_square, &c.bearing_mean, &c.bearing_mean_square})
    json.check(column->size() == size, "cells", "has columns of different lengths");
  for (std::size_t at = 0; at < size; ++at)
    json.check(c.count[at] >= 1.0 && c.range_mean[at] > 0.0 && c.range_mean_square[at] >= 0.0 &&
                   c.bearing_mean_square[at] >= 0.0,
               "cells", "holds what no readings make");
}

/// What follows from the stops and cells of a past that was read.
void complete(const JsonFields& json, const std::vector<SavedStop>& stops, JointProblem& past) {
  for (const double radius : past.landmark_radius_m) json.check(radius >= 0.0, "radius_m", "is negative");
  past.landmark_recording.assign(past.landmark_radius_m.size(), 0);
  Cells& c = past.cells;
  check_readings(json, c);
  c.stop_begin = {0};
  for (const SavedStop& saved : stops) {
    StopPrior prior = saved.prior;
    prior.opens_place = prior.opens_place || past.stops.empty();
    past.place_count += prior.opens_place;
    prior.place = past.place_count - 1;
    json.check(static_cast<std::size_t>(saved.cells) <= c.landmark.size() - c.stop.size(), "stops",
               "has more cells than there are");
    c.stop.insert(c.stop.end(), static_cast<std::size_t>(saved.cells), past.stop_count());
    past.stops.push_back(prior);
    past.sigma_s_shared.push_back(0);
    c.stop_begin.push_back(static_cast<int>(c.stop.size()));
  }
  json.check(c.stop.size() == c.landmark.size(), "cells", "has cells of no stop");
  for (std::size_t at = 0; at < c.stop.size(); ++at) {
    json.check(c.landmark[at] >= 0 && c.landmark[at] < past.landmark_count(), "cells.landmark",
               "is of no landmark");
    c.radius_m.push_back(past.landmark_radius_m[static_cast<std::size_t>(c.landmark[at])]);
    past.readings += c.count[at];
  }
  c.range_weight = c.bearing_weight = c.count;
}

}  // namespace

static void fields(JsonFields& json, LandmarkSums& sums) {
  json.numbers("centre", sums.grid.centre, 2);
  json.required("half_width", sums.grid.half_width);
  json.check(sums.grid.half_width > 0.0 && sums.grid.half_width < 10.0, "half_width", "is no width");
  json.numbers("reference", sums.reference);
  const Index size = sums.reference.size();
  json.numbers("value", sums.value, SigmaGrid::nodes);
  json.numbers("beyond", sums.beyond, size, size);
  lists_field(json, "gradient", sums.gradient, SigmaGrid::nodes, size);
  lists_field(json, "hessian", sums.hessian, SigmaGrid::nodes, size, size);
  const Index cubed = size > LandmarkSums::most_cubed ? 0 : size;
  lists_field(json, "third", sums.third, static_cast<std::size_t>(cubed), size, size);
  if (!json.has("last_pose") && !sums.last_pose) return;
  if (json.reading()) sums.last_pose.emplace();
  json.object("last_pose", [&](JsonFields& law) { last_pose_fields(law, *sums.last_pose, size); });
}

static void fields(JsonFields& json, JointState& state) {
  if (json.reading()) state.noise.parameters = VectorXd::Zero(1);
  json.numbers("alpha", state.alpha);
  json.required("sigma", state.noise.parameters[0]);
  json.required("sigma_theta", state.sigma_theta_rad);
  json.check(state.noise.parameters[0] > 0.0, "sigma", "is not positive");
  json.check(state.sigma_theta_rad > 0.0, "sigma_theta", "is not positive");
  json.required("landmarks", state.landmarks);
  for (const Eigen::Vector2d& landmark : state.landmarks)
    json.check(landmark.allFinite(), "landmarks", "is not finite");
}

static void fields(JsonFields& json, Cells& cells) {
  json.required("landmark", cells.landmark);
  json.required("count", cells.count);
  json.required("range_mean", cells.range_mean);
  json.required("range_mean_square", cells.range_mean_square);
  json.required("bearing_mean", cells.bearing_mean);
  json.required("bearing_mean_square", cells.bearing_mean_square);
}

/// Stops of independent errors.
static void fields(JsonFields& json, JointProblem& past) {
  std::vector<SavedStop> stops;
  for (std::size_t k = 0; k < past.stops.size(); ++k)
    stops.push_back({past.stops[k], past.cells.stop_begin[k + 1] - past.cells.stop_begin[k]});
  json.required("radius_m", past.landmark_radius_m);
  json.required("stops", stops);
  json.required("cells", past.cells);
  if (json.reading()) complete(json, stops, past);
}

static void fields(JsonFields& json, RobustShapes& shapes) { json.row(shapes.range, shapes.bearing); }

/// Of the state, what is kept otherwise.
struct RecursiveLandmarks::Saved {
  std::vector<SavedLandmark> landmarks;
  std::vector<HeldStop> held;
  Cells cells;
  bool anchored = false;
};

void fields(JsonFields& json, RecursiveLandmarks& tracked) {
  RecursiveLandmarks& t = tracked;
  RecursiveLandmarksOptions& options = t.options_;
  RecursiveLandmarks::Saved saved;
  if (json.writing()) {
    const JointProblem& held = t.held_;
    for (std::size_t l = 0; l < t.labels_.size(); ++l)
      saved.landmarks.push_back({t.labels_[l], held.landmark_radius_m[l], t.bearings_[l].state()});
    for (std::size_t k = 0; k < held.stops.size(); ++k)
      saved.held.push_back({{held.stops[k], held.cells.stop_begin[k + 1] - held.cells.stop_begin[k]},
                            t.held_labels_[k],
                            t.held_places_[static_cast<std::size_t>(held.stops[k].place)]});
    saved.cells = held.cells;
    saved.anchored = t.anchored_;
  }

  const std::size_t versions_ago = json.format(
      {"rangecal-recursive-landmarks/3", "rangecal-recursive-landmarks/2", "rangecal-recursive-landmarks/1"});
  const bool knows_shapes = versions_ago < 1,  // else Gaussian noise alone
      knows_past = versions_ago < 2;           // else no squared sums either
  order_field(json, options.order);
  json.whole("max_order", options.max_order);
  json.word("law", options.law, noise_law_from_string);
  json.required("sigma_xy_m", options.sigma_xy_m);
  json.required("sigma_heading_rad", options.sigma_heading_rad);
  json.required("sigma_theta_rad", options.sigma_theta_rad);
  if (json.writing() || json.has("random_walk")) {  // states of 0.1.0 do not know it
    json.required("random_walk", options.random_walk);
    json.numbers("walked", t.walked_, 3, 3);
    json.numbers("first_covariance", t.first_covariance_, 3, 3);
    json.numbers("first_position_m", t.first_position_m_, 2);
    json.required("anchored", saved.anchored);
  }
  if (knows_shapes) {
    json.word("noise_shape", options.noise_shape, noise_shape_from_string);
    json.required("shapes", t.shapes_);
    residuals_field(json, "range_residuals", *t.range_residuals_);
    residuals_field(json, "bearing_residuals", *t.bearing_residuals_);
    gap_field(json, "gap", t.gap_);
    gap_field(json, "squared_gap", t.squared_gap_);
    json.whole("outliers", t.outliers_);
  } else {
    options.noise_shape = NoiseShape::gaussian;
  }
  forget_field(json, options.forget);
  json.whole("block", options.block);
  json.whole("used", t.used_);
  json.whole("stops", t.stops_);
  json.required("weights", std::tie(t.sum_w_, t.sum_w_sq_));
  std::optional<double> low;  // null before the first
  if (std::isfinite(t.low_m_)) low = t.low_m_;
  json.required("distances_m", std::tie(low, t.high_m_));
  if (low && json.reading()) t.low_m_ = *low;
  counts_field(json, t.counts_);
  json.required("landmarks", saved.landmarks);
  json.required("held", saved.held);
  json.required("cells", saved.cells);
  if (knows_past) {
    json.whole("tried_at", t.tried_at_);
    json.whole("stops_left_out", t.stops_left_out_);
    json.required("past", t.past_);
    json.whole("anew_stops", t.anew_stops_);
  }
  json.required("last", t.last_);
  json.required("sums", t.sums_);
  if (knows_past) json.required("squared", t.squared_);
  if (json.writing()) return;

  options.check();
  if (!knows_past && t.sums_ && std::isfinite(options.forget)) {
    t.squared_ = std::make_unique<LandmarkSums>(*t.sums_);
    if (t.sum_w_ > 0.0) t.squared_->scale(t.sum_w_sq_ / t.sum_w_);
  }
  t.hold_again(json, saved);
  if (t.last_) t.last_->noise.law = options.law;
  if (t.past_) t.past_->rows_alike = t.looks_for_outliers();
  t.check_sums(json);
}

/// The landmarks known, and the stops held with their cells.
void RecursiveLandmarks::hold_again(const JsonFields& json, const Saved& saved) {
  const int tried_at = tried_at_;
  clear_held();
  tried_at_ = tried_at;
  for (const SavedLandmark& landmark : saved.landmarks) {
    LandmarkReading known;
    known.landmark = landmark.label;
    known.radius_m = landmark.radius_m;
    landmark_of(known);
    bearings_.back().restore(landmark.bearings);
  }
  json.check(labels_.size() == saved.landmarks.size(), "landmarks", "names one twice");
  const Cells& cells = saved.cells;
  check_readings(json, cells);
  std::size_t cell = 0;
  for (const HeldStop& held : saved.held) {
    Stop stop;
    stop.label = held.label;
    stop.commanded = held.prior.commanded;
    stop.sigma_xy_m = held.prior.sigma_xy_m;
    stop.sigma_heading_rad = held.prior.sigma_heading_rad;
    StopPrior prior = prior_of(stop);
    prior.shape = held.prior.shape;
    prior.chained = options_.random_walk && !held_labels_.empty();
    hold(held.label, prior, held.prior.opens_place || held_places_.empty() ? &held.place : nullptr);
    for (int i = held.cells; i > 0; --i, ++cell) {
      json.check(cell < cells.landmark.size(), "held", "has more cells than there are");
      const int landmark = cells.landmark[cell];
      json.check(landmark >= 0 && landmark < static_cast<int>(labels_.size()), "cells.landmark",
                 "is of no landmark");
      const std::size_t at =
          looks_for_outliers() ? new_cell(held_.cells.size(), landmark) : cell_of(landmark);
      json.check(at == cell, "cells", "holds a landmark twice at one stop");
      Cells& c = held_.cells;
      c.count[at] = c.range_weight[at] = c.bearing_weight[at] = cells.count[at];
      c.range_mean[at] = cells.range_mean[at];
      c.range_mean_square[at] = cells.range_mean_square[at];
      c.bearing_mean[at] = cells.bearing_mean[at];
      c.bearing_mean_square[at] = cells.bearing_mean_square[at];
      held_.readings += c.count[at];
    }
  }
  json.check(tried_at_ <= held_.stop_count(), "tried_at", "is more than there are stops in 'held'");
  anchored_ = saved.anchored;
  const bool known = sums_ && sums_->last_pose && !held_labels_.empty();
  json.check(!options_.random_walk || (anchored_ == known && (known || !sums_)), "anchored",
             "does not go with what is held");
}

/// What is summed up is about the landmarks known, and the parts of it about the same.
void RecursiveLandmarks::check_sums(const JsonFields& json) const {
  const Index phis = options_.columns() + 2 * static_cast<Index>(labels_.size());
  json.check(gap_.rows() <= phis, "gap", "is of more landmarks than there are");
  json.check(squared_gap_.rows() <= phis, "squared_gap", "is of more landmarks than there are");
  json.check(!last_ == !sums_, "last", "does not go with 'sums'");
  json.check(!squared_ == !(sums_ && std::isfinite(options_.forget)), "squared", "does not go with 'sums'");
  json.check(!past_ || (sums_ && !options_.random_walk && !squared_ && !past_->stops.empty() &&
                        past_->landmark_radius_m.size() <= last_->landmarks.size()),
             "past", "does not go with what is summed up");
  json.check(!past_ || anew_stops_ <= past_->stop_count(), "anew_stops",
             "is more than there are stops in 'past'");
  if (!sums_) return;
  json.check(sums_->reference.size() <= phis, "sums.reference", "is of more landmarks than there are");
  json.check(
      !squared_ || (squared_->reference == sums_->reference && squared_->grid.centre == sums_->grid.centre &&
                    squared_->grid.half_width == sums_->grid.half_width),
      "squared", "is not about what 'sums' are");
  json.check(last_->alpha.size() == options_.columns(), "last.alpha",
             "has not " + std::to_string(options_.columns()) + " numbers");
  json.check(options_.columns() + 2 * static_cast<Index>(last_->landmarks.size()) == sums_->reference.size(),
             "last", "is of other landmarks than the sums");
}

std::string RecursiveLandmarks::to_json() const {
  JsonFields::Written state;
  // not by copy, which it has none of; writing changes nothing
  JsonFields(state).convert(const_cast<RecursiveLandmarks&>(*this));
  return state.dump() + "\n";
}

RecursiveLandmarks RecursiveLandmarks::from_json(const std::string& text, const std::string& name) {
  RecursiveLandmarks tracked;
  read_json(text, name, tracked);
  return tracked;
}

}  // namespace rangecal
