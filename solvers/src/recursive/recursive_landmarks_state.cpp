// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "json_matrices.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/stops_io.hpp"
#include "recursive/landmark_answer.hpp"
#include "recursive/residual_sketch.hpp"
#include "robust/shape_json.hpp"

namespace rangecal {
namespace {

using Json = nlohmann::ordered_json;
using Eigen::MatrixXd;
using Eigen::VectorXd;
constexpr const char* format_name = "rangecal-recursive-landmarks/3";
constexpr const char* gaussian_format = "rangecal-recursive-landmarks/2";  // knows Gaussian noise alone
constexpr const char* format_before = "rangecal-recursive-landmarks/1";    // nor squared sums, nor a past

Json json_of(const ResidualSketch& sketch) {
  Json json = Json::array();
  for (const auto& [place, sums] : sketch.cells) json.push_back({place.first, place.second, sums});
  return json;
}

void restore(const Json& json, ResidualSketch& sketch) {
  for (const Json& cell : json) {
    const auto index = [&](std::size_t i) { return whole_number(cell.at(i), "residuals", -100000, 100000); };
    const auto sums = cell.at(2).get<std::array<double, 4>>();
    if (!(sums[0] > 0.0 && sums[3] > 0.0)) throw InputError("field 'residuals' holds what no readings make");
    sketch.cells[{index(0), index(1)}] = sums;
  }
}

Json json_of(const LastPose& law) {
  return {{"free", {law.free_position, law.free_heading}},
          {"pose", {law.exact.x_m, law.exact.y_m, law.exact.heading_rad}},
          {"mean", lists(law.mean)},
          {"slope", lists(law.slope)},
          {"covariance", lists(law.covariance)},
          {"bend", lists(law.bend)},
          {"turn", lists(law.turn)}};
}

LastPose last_pose_in(const Json& json, Eigen::Index phis) {
  LastPose law;
  law.free_position = json.at("free").at(0);
  law.free_heading = json.at("free").at(1);
  law.exact = {json.at("pose").at(0), json.at("pose").at(1), json.at("pose").at(2)};
  const Eigen::Index dim = law.dim();
  for (std::size_t q = 0; q < SigmaGrid::nodes; ++q) {
    law.mean.push_back(vector_in(json.at("mean").at(q), dim, "mean"));
    law.slope.push_back(vector_in(json.at("slope").at(q), dim * phis, "slope").reshaped(dim, phis));
    law.covariance.push_back(square_in(json.at("covariance").at(q), dim, "covariance"));
  }
  for (std::size_t i = 0; i < static_cast<std::size_t>(phis); ++i) {
    law.bend.push_back(square_in(json.at("bend").at(i), dim, "bend"));
    law.turn.push_back(vector_in(json.at("turn").at(i), dim * phis, "turn").reshaped(dim, phis));
  }
  return law;
}

Json json_of(const LandmarkSums& sums) {
  Json json{{"centre", {sums.grid.centre.x(), sums.grid.centre.y()}},
            {"half_width", sums.grid.half_width},
            {"reference", list(sums.reference)},
            {"value", list(sums.value)},
            {"beyond", list(sums.beyond)},
            {"gradient", lists(sums.gradient)},
            {"hessian", lists(sums.hessian)},
            {"third", lists(sums.third)}};
  if (sums.last_pose) json["last_pose"] = json_of(*sums.last_pose);
  return json;
}

LandmarkSums sums_in(const Json& json, Eigen::Index largest) {
  LandmarkSums sums;
  sums.grid.centre = vector_in(json.at("centre"), 2, "centre");
  sums.grid.half_width = json.at("half_width");
  if (!(sums.grid.half_width > 0.0 && sums.grid.half_width < 10.0))
    throw InputError("field 'half_width' is no width");
  const auto size = static_cast<Eigen::Index>(json.at("reference").size());
  if (size > largest) throw InputError("field 'reference' is of more landmarks than there are");
  sums.reference = vector_in(json.at("reference"), size, "reference");
  sums.value = vector_in(json.at("value"), SigmaGrid::nodes, "value");
  sums.beyond = square_in(json.at("beyond"), size, "beyond");
  for (int q = 0; q < SigmaGrid::nodes; ++q) {
    sums.gradient.push_back(vector_in(json.at("gradient").at(static_cast<std::size_t>(q)), size, "gradient"));
    sums.hessian.push_back(square_in(json.at("hessian").at(static_cast<std::size_t>(q)), size, "hessian"));
  }
  for (const Json& t : json.at("third")) sums.third.push_back(square_in(t, size, "third"));
  if (sums.third.size() != (size > LandmarkSums::most_cubed ? 0 : static_cast<std::size_t>(size)))
    throw InputError("field 'third' is not whole");
  if (json.contains("last_pose")) sums.last_pose = last_pose_in(json.at("last_pose"), size);
  return sums;
}

Json json_of(const JointState& state) {
  Json json{{"alpha", list(state.alpha)},
            {"sigma", state.noise.parameters[0]},
            {"sigma_theta", state.sigma_theta_rad},
            {"landmarks", Json::array()}};
  for (const Eigen::Vector2d& landmark : state.landmarks)
    json["landmarks"].push_back({landmark.x(), landmark.y()});
  return json;
}

/// The columns of the cells that hold numbers.
std::vector<std::pair<const char*, std::vector<double> Cells::*>> columns() {
  return {{"count", &Cells::count},
          {"range_mean", &Cells::range_mean},
          {"range_mean_square", &Cells::range_mean_square},
          {"bearing_mean", &Cells::bearing_mean},
          {"bearing_mean_square", &Cells::bearing_mean_square}};
}

Json json_of(const Cells& cells) {
  Json json{{"landmark", cells.landmark}};
  for (const auto& [name, column] : columns()) json[name] = cells.*column;
  return json;
}

/// No cell that readings do not make.
void require_readings(const Cells& c, std::size_t at) {
  if (!(c.count[at] >= 1.0) || !(c.range_mean[at] > 0.0) || !(c.range_mean_square[at] >= 0.0) ||
      !(c.bearing_mean_square[at] >= 0.0))
    throw InputError("field 'cells' holds what no readings make");
}

std::shared_ptr<const Eigen::Matrix3d> shape_in(const Json& json) {
  const Eigen::Matrix3d Q = square_in(json, 3, "shape");
  if (!stop_covariance(covariance_entries(Q), 0.0).fault.empty())
    throw InputError("field 'shape' is that of no covariance");
  return std::make_shared<const Eigen::Matrix3d>(Q);
}

/// Stops of independent errors.
Json json_of(const JointProblem& past) {
  Json json{{"radius_m", past.landmark_radius_m}, {"stops", Json::array()}, {"cells", json_of(past.cells)}};
  for (std::size_t k = 0; k < past.stops.size(); ++k) {
    const StopPrior& stop = past.stops[k];
    json["stops"].push_back({{"pose", {stop.commanded.x_m, stop.commanded.y_m, stop.commanded.heading_rad}},
                             {"sigma", {stop.sigma_xy_m, stop.sigma_heading_rad}},
                             {"shape", stop.shape ? list(MatrixXd(*stop.shape)) : Json(nullptr)},
                             {"opens_place", stop.opens_place},
                             {"cells", past.cells.stop_begin[k + 1] - past.cells.stop_begin[k]}});
  }
  return json;
}

JointProblem past_in(const Json& json) {
  JointProblem past;
  past.landmark_radius_m = json.at("radius_m").get<std::vector<double>>();
  for (const double radius : past.landmark_radius_m)
    if (!(radius >= 0.0 && std::isfinite(radius)))
      throw InputError("field 'past.radius_m' is not finite, or negative");
  past.landmark_recording.assign(past.landmark_radius_m.size(), 0);
  const std::size_t listed = json.at("cells").at("landmark").size();
  Cells& c = past.cells;
  c.stop_begin = {0};
  for (const Json& stop : json.at("stops")) {
    StopPrior prior;
    const VectorXd pose = vector_in(stop.at("pose"), 3, "pose"),
                   sigma = vector_in(stop.at("sigma"), 2, "sigma");
    prior.commanded = {pose[0], pose[1], pose[2]};
    prior.sigma_xy_m = sigma[0];
    prior.sigma_heading_rad = sigma[1];
    if (!(sigma.minCoeff() >= 0.0)) throw InputError("field 'past.stops.sigma' is negative");
    if (!stop.at("shape").is_null()) prior.shape = shape_in(stop.at("shape"));
    prior.opens_place = stop.at("opens_place").get<bool>() || past.stops.empty();
    past.place_count += prior.opens_place;
    prior.place = past.place_count - 1;
    const auto left = static_cast<int>(listed - c.stop.size());
    for (int i = whole_number(stop.at("cells"), "past.stops.cells", 0, left); i > 0; --i)
      c.stop.push_back(past.stop_count());
    past.stops.push_back(prior);
    past.sigma_s_shared.push_back(0);
    c.stop_begin.push_back(static_cast<int>(c.stop.size()));
  }
  const Json& cells = json.at("cells");
  const auto size = static_cast<Eigen::Index>(c.stop.size());
  if (c.stop.size() != listed) throw InputError("field 'past.cells' has cells of no stop");
  for (const auto& [field, column] : columns()) {
    const VectorXd values = vector_in(cells.at(field), size, field);
    (c.*column).assign(values.begin(), values.end());
  }
  for (std::size_t at = 0; at < c.stop.size(); ++at) {
    require_readings(c, at);
    c.landmark.push_back(whole_number(cells.at("landmark").at(at), "landmark", 0, past.landmark_count() - 1));
    c.radius_m.push_back(past.landmark_radius_m[static_cast<std::size_t>(c.landmark.back())]);
    past.readings += c.count[at];
  }
  c.range_weight = c.bearing_weight = c.count;
  return past;
}

}  // namespace

std::string RecursiveLandmarks::to_json() const {
  Json state{{"format", format_name},
             {"order", options_.order ? Json(*options_.order) : Json("auto")},
             {"max_order", options_.max_order},
             {"law", to_string(options_.law)},
             {"sigma_xy_m", options_.sigma_xy_m},
             {"sigma_heading_rad", options_.sigma_heading_rad},
             {"sigma_theta_rad", options_.sigma_theta_rad},
             {"random_walk", options_.random_walk},
             {"walked", list(MatrixXd(walked_))},
             {"first_covariance", list(MatrixXd(first_covariance_))},
             {"first_position_m", {first_position_m_.x(), first_position_m_.y()}},
             {"anchored", anchored_},
             {"noise_shape", to_string(options_.noise_shape)},
             {"shapes", shapes_ ? Json{shape_list<Json>(shapes_->range), shape_list<Json>(shapes_->bearing)}
                                : Json(nullptr)},
             {"range_residuals", json_of(*range_residuals_)},
             {"bearing_residuals", json_of(*bearing_residuals_)},
             {"gap", list(gap_)},
             {"squared_gap", list(squared_gap_)},
             {"outliers", outliers_},
             {"forget", std::isfinite(options_.forget) ? Json(options_.forget) : Json(nullptr)},
             {"block", options_.block},
             {"used", used_},
             {"stops", stops_},
             {"weights", {sum_w_, sum_w_sq_}},
             {"distances_m", {std::isfinite(low_m_) ? Json(low_m_) : Json(nullptr), high_m_}},
             {"counts", {{"read", counts_.read}, {"used", counts_.used}, {"dropped", counts_.dropped}}},
             {"landmarks", Json::array()},
             {"held", Json::array()},
             {"cells", json_of(held_.cells)},
             {"tried_at", tried_at_},
             {"stops_left_out", stops_left_out_},
             {"past", past_ ? json_of(*past_) : Json(nullptr)},
             {"anew_stops", anew_stops_},
             {"last", last_ ? json_of(*last_) : Json(nullptr)},
             {"sums", sums_ ? json_of(*sums_) : Json(nullptr)},
             {"squared", squared_ ? json_of(*squared_) : Json(nullptr)}};
  for (std::size_t l = 0; l < labels_.size(); ++l)
    state["landmarks"].push_back({{"label", labels_[l]},
                                  {"radius_m", held_.landmark_radius_m[l]},
                                  {"bearings", bearings_[l].state()}});
  for (std::size_t k = 0; k < held_.stops.size(); ++k) {
    const StopPrior& stop = held_.stops[k];
    state["held"].push_back({{"label", held_labels_[k]},
                             {"pose", {stop.commanded.x_m, stop.commanded.y_m, stop.commanded.heading_rad}},
                             {"sigma", {stop.sigma_xy_m, stop.sigma_heading_rad}},
                             {"shape", stop.shape ? list(MatrixXd(*stop.shape)) : Json(nullptr)},
                             {"place", held_places_[static_cast<std::size_t>(stop.place)]},
                             {"opens_place", stop.opens_place},
                             {"cells", held_.cells.stop_begin[k + 1] - held_.cells.stop_begin[k]}});
  }
  return state.dump() + "\n";
}

RecursiveLandmarks RecursiveLandmarks::from_json(const std::string& text, const std::string& name) {
  try {
    const Json state = Json::parse(text);
    const bool before = state.at("format") == format_before,
               gaussian = before || state.at("format") == gaussian_format;
    if (!gaussian && state.at("format") != format_name)
      throw InputError(std::string("field 'format' is not '") + format_name + "'");
    RecursiveLandmarksOptions options;
    options.order.reset();
    if (state.at("order").is_number()) options.order = whole_number(state.at("order"), "order");
    options.max_order = whole_number(state.at("max_order"), "max_order");
    options.law = noise_law_from_string(state.at("law").get<std::string>());
    options.sigma_xy_m = state.at("sigma_xy_m");
    options.sigma_heading_rad = state.at("sigma_heading_rad");
    options.sigma_theta_rad = state.at("sigma_theta_rad");
    const bool walks = state.contains("random_walk");  // states of 0.1.0 do not know it
    options.random_walk = walks && state.at("random_walk").get<bool>();
    if (state.at("forget").is_number()) options.forget = state.at("forget");
    options.noise_shape =
        gaussian ? NoiseShape::gaussian : noise_shape_from_string(state.at("noise_shape").get<std::string>());
    options.block = whole_number(state.at("block"), "block");
    RecursiveLandmarks result(options);
    result.sum_w_ = state.at("weights").at(0);
    result.sum_w_sq_ = state.at("weights").at(1);
    if (state.at("distances_m").at(0).is_number()) result.low_m_ = state.at("distances_m").at(0);
    result.high_m_ = state.at("distances_m").at(1);
    for (const Json& landmark : state.at("landmarks")) {
      LandmarkReading known;
      known.landmark = landmark.at("label");
      known.radius_m = landmark.at("radius_m");
      if (!(known.radius_m >= 0.0)) throw InputError("field 'radius_m' is negative");
      result.landmark_of(known);
      result.bearings_.back().restore(
          landmark.at("bearings").get<std::array<double, RecursiveBearings::state_size>>());
    }
    if (result.labels_.size() != state.at("landmarks").size())
      throw InputError("field 'landmarks' names one twice");
    const auto phis = options.columns() + 2 * static_cast<Eigen::Index>(result.labels_.size());
    const Json& cells = state.at("cells");
    std::size_t cell = 0;
    for (const Json& held : state.at("held")) {
      Stop stop;
      stop.label = held.at("label");
      stop.commanded = {held.at("pose").at(0), held.at("pose").at(1), held.at("pose").at(2)};
      stop.sigma_xy_m = held.at("sigma").at(0).get<double>();
      stop.sigma_heading_rad = held.at("sigma").at(1).get<double>();
      stop.place = held.at("place");
      const bool opens = held.at("opens_place").get<bool>() || result.held_places_.empty();
      StopPrior prior = result.prior_of(stop);
      if (held.contains("shape") && held.at("shape").is_array()) prior.shape = shape_in(held.at("shape"));
      prior.chained = options.random_walk && !result.held_labels_.empty();
      result.hold(stop.label, prior, opens ? &stop.place : nullptr);
      for (int i = whole_number(held.at("cells"), "cells"); i > 0; --i, ++cell) {
        const int landmark = whole_number(cells.at("landmark").at(cell), "landmark", 0,
                                          static_cast<int>(result.labels_.size()) - 1);
        const std::size_t at = result.looks_for_outliers()
                                   ? result.new_cell(result.held_.cells.size(), landmark)
                                   : result.cell_of(landmark);
        if (at != cell) throw InputError("field 'cells' holds a landmark twice at one stop");
        for (const auto& [field, column] : columns())
          (result.held_.cells.*column)[at] = cells.at(field).at(cell);
        Cells& c = result.held_.cells;
        require_readings(c, at);
        c.range_weight[at] = c.bearing_weight[at] = c.count[at];
        result.held_.readings += c.count[at];
      }
    }
    result.used_ = whole_number<std::int64_t>(state.at("used"), "used");
    result.stops_ = whole_number<std::int64_t>(state.at("stops"), "stops");
    const Json& counts = state.at("counts");
    result.counts_.read = whole_number(counts.at("read"), "read");
    result.counts_.used = whole_number(counts.at("used"), "used");
    for (const auto& [reason, count] : counts.at("dropped").items())
      result.counts_.dropped[reason] = whole_number(count, "dropped");
    if (state.at("sums").is_object()) {
      result.sums_ = std::make_unique<LandmarkSums>(sums_in(state.at("sums"), phis));
      if (std::isfinite(options.forget)) {
        result.squared_ =
            std::make_unique<LandmarkSums>(before ? *result.sums_ : sums_in(state.at("squared"), phis));
        if (before && result.sum_w_ > 0.0) result.squared_->scale(result.sum_w_sq_ / result.sum_w_);
        if (result.squared_->reference != result.sums_->reference ||
            result.squared_->grid.centre != result.sums_->grid.centre ||
            result.squared_->grid.half_width != result.sums_->grid.half_width)
          throw InputError("field 'squared' is not about what 'sums' are");
      }
      const Json& last = state.at("last");
      JointState at;
      at.alpha = vector_in(last.at("alpha"), options.columns(), "alpha");
      at.noise = {options.law, VectorXd::Constant(1, last.at("sigma").get<double>())};
      at.sigma_theta_rad = last.at("sigma_theta");
      if (!(at.noise.parameters[0] > 0.0 && at.sigma_theta_rad > 0.0))
        throw InputError("field 'last' has a sigma that is not positive");
      for (const Json& landmark : last.at("landmarks"))
        at.landmarks.emplace_back(landmark.at(0).get<double>(), landmark.at(1).get<double>());
      if (options.columns() + 2 * static_cast<Eigen::Index>(at.landmarks.size()) !=
          result.sums_->reference.size())
        throw InputError("field 'last' is of other landmarks than the sums");
      result.last_ = at;
      if (!before && !state.at("past").is_null()) {
        result.past_ = std::make_unique<JointProblem>(past_in(state.at("past")));
        result.past_->rows_alike = result.looks_for_outliers();
        if (options.random_walk || result.squared_ || result.past_->stops.empty() ||
            result.past_->landmark_radius_m.size() > at.landmarks.size())
          throw InputError("field 'past' does not go with what is summed up");
      }
    }
    if (!before) {  // version 1 keeps no stops that are summed up
      result.tried_at_ = whole_number(state.at("tried_at"), "tried_at", 0, result.held_.stop_count());
      result.anew_stops_ = whole_number(state.at("anew_stops"), "anew_stops");
      if (result.past_ && result.anew_stops_ > result.past_->stop_count())
        throw InputError("field 'anew_stops' is more than there are stops in 'past'");
      result.stops_left_out_ = whole_number<std::int64_t>(state.at("stops_left_out"), "stops_left_out");
    }
    if (!gaussian) {
      restore(state.at("range_residuals"), *result.range_residuals_);
      restore(state.at("bearing_residuals"), *result.bearing_residuals_);
      if (const Json& shapes = state.at("shapes"); shapes.is_array()) {
        result.shapes_.emplace();
        result.shapes_->range = shape_in_list(shapes.at(0));
        result.shapes_->bearing = shape_in_list(shapes.at(1));
      }
      result.outliers_ = whole_number(state.at("outliers"), "outliers");
      const auto gap_in = [&](const char* field) {
        const auto size = static_cast<Eigen::Index>(std::lround(std::sqrt(state.at(field).size())));
        if (size > phis)
          throw InputError(std::string("field '") + field + "' is of more landmarks than there are");
        return size > 0 ? square_in(state.at(field), size, field) : MatrixXd();
      };
      result.gap_ = gap_in("gap");
      result.squared_gap_ = gap_in("squared_gap");
    }
    if (options.random_walk) {
      result.walked_ = square_in(state.at("walked"), 3, "walked");
      result.first_covariance_ = square_in(state.at("first_covariance"), 3, "first_covariance");
      result.first_position_m_ = vector_in(state.at("first_position_m"), 2, "first_position_m");
      result.anchored_ = state.at("anchored");
      const bool known = result.sums_ && result.sums_->last_pose && !result.held_labels_.empty();
      if (result.anchored_ != known || (!known && result.sums_))
        throw InputError("field 'anchored' does not go with what is held");
    }
    return result;
  } catch (const Json::exception& error) {
    throw InputError(name, 0, "", "is no state of a tracked calibration: " + json_complaint(error));
  } catch (const InputError& error) {
    throw InputError(name, 0, "", error.what());
  }
}

}  // namespace rangecal
