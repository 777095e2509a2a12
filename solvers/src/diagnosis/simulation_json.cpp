// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/json_fields.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"

namespace rangecal {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }
double number_of(const Json& json) { return json.is_null() ? std::nan("") : json.get<double>(); }

Json column(const std::vector<double>& values) {
  Json json = Json::array();
  for (double value : values) json.push_back(number(value));
  return json;
}

std::vector<double> column_of(const Json& parent, const char* name) {
  std::vector<double> values;
  if (parent.contains(name))
    for (const Json& value : parent.at(name)) values.push_back(number_of(value));
  return values;
}

bool holds(const Json& parent, const char* name) { return parent.contains(name) && !parent.at(name).empty(); }

template <typename T>
std::vector<T> list_of(const Json& parent, const char* name) {
  return parent.contains(name) ? parent.at(name).get<std::vector<T>>() : std::vector<T>{};
}

Json covariates(const Covariates& columns) {
  Json json = Json::object();
  for (const auto& [name, values] : columns) json[name] = column(values);
  return json;
}

Json recording_to_json(const SimulationModel& model, std::size_t index) {
  const Recording& r = model.recordings[index];
  Json json;
  json["kind"] = r.kind == RecordingKind::pairs ? "pairs" : "landmarks";
  json["sensor"] = {{"name", r.sensor.name},
                    {"principle", r.sensor.principle},
                    {"range_min_m", r.sensor.range_min_m},
                    {"range_max_m", number(r.sensor.range_max_m)}};
  json["sigma_xy_m"] = r.sigma_xy_m;
  json["estimate_sigma_xy"] = r.estimate_sigma_xy;
  json["sigma_heading_rad"] = r.sigma_heading_rad;
  json["error"] = r.stop_error == StopErrorModel::random_walk ? "random_walk" : "independent";
  json["stops"] = Json::array();
  for (const Stop& s : r.stops) {
    Json stop = {{"stop", s.label},
                 {"x_m", s.commanded.x_m},
                 {"y_m", s.commanded.y_m},
                 {"heading_rad", s.commanded.heading_rad}};
    if (s.sigma_xy_m) stop["sigma_xy_m"] = *s.sigma_xy_m;
    if (s.sigma_heading_rad) stop["sigma_heading_rad"] = *s.sigma_heading_rad;
    if (!s.place.empty()) stop["place"] = s.place;
    if (s.covariance) {
      const CovarianceEntries entries = covariance_entries(*s.covariance);
      for (std::size_t i = 0; i < entries.size(); ++i) stop[covariance_columns[i]] = *entries[i];
    }
    json["stops"].push_back(stop);
  }
  json["landmarks"] = Json::array();
  for (const Landmark& l : r.landmarks) {
    Json landmark = {{"landmark", l.label}, {"radius_m", l.radius_m}};
    if (l.reflectance) landmark["reflectance"] = *l.reflectance;
    for (const LandmarkEstimate& e : model.calibration.landmarks)
      if (e.recording == static_cast<int>(index) && e.label == l.label) {
        landmark["x_m"] = e.position_m.x();
        landmark["y_m"] = e.position_m.y();
      }
    json["landmarks"].push_back(landmark);
  }
  json["known_distances"] = Json::array();
  for (const KnownDistance& k : r.known_distances)
    json["known_distances"].push_back(
        {{"from", k.from}, {"to", k.to}, {"distance_m", k.distance_m}, {"sigma_m", k.sigma_m}});
  Json readings;
  if (r.kind == RecordingKind::pairs) {
    readings = {{"true_m", column(r.pairs.true_m)},
                {"batch", r.pairs.batch},
                {"batch_labels", r.pairs.batch_labels},
                {"landmark", r.pairs.landmark},
                {"time_s", column(r.pairs.time_s)},
                {"bearing_rad", column(r.pairs.bearing_rad)},
                {"covariates", covariates(r.pairs.covariates)}};
  } else {
    readings = {{"stop", r.readings.stop},
                {"landmark", r.readings.landmark},
                {"repeat", r.readings.repeat},
                {"time_s", column(r.readings.time_s)},
                {"covariates", covariates(r.readings.covariates)}};
    if (index < model.landmark_read.size() && model.landmark_read[index] != r.readings.landmark)
      readings["landmark_read"] = model.landmark_read[index];
  }
  if (index < model.added.size()) {
    const AddedChange& added = model.added[index];
    Json changes = Json::object();
    if (!added.range_m.empty()) changes["range_m"] = column(added.range_m);
    if (!added.bearing_rad.empty()) changes["bearing_rad"] = column(added.bearing_rad);
    if (!added.range_log_variance.empty()) changes["range_log_variance"] = column(added.range_log_variance);
    if (!added.bearing_log_variance.empty())
      changes["bearing_log_variance"] = column(added.bearing_log_variance);
    if (!changes.empty()) readings["added"] = changes;
  }
  json["readings"] = readings;
  return json;
}

/// Indices from 0 to count - 1, one per reading; -1 where `or_none`.
std::vector<int> indices_of(const Json& parent, const char* name, std::size_t count, std::size_t readings,
                            bool or_none = false) {
  std::vector<int> indices;
  if (parent.contains(name))
    for (const Json& value : parent.at(name))
      indices.push_back(whole_number(value, name, or_none ? -1 : 0, static_cast<int>(count) - 1));
  if (indices.size() != readings)
    throw InputError(fmt::format("simulation: {} has {} entries, not {}", name, indices.size(), readings));
  return indices;
}

/// Nothing, or one value per reading.
std::vector<double> column_of(const Json& parent, const char* name, std::size_t readings) {
  std::vector<double> values = column_of(parent, name);
  if (!values.empty() && values.size() != readings)
    throw InputError(fmt::format("simulation: {} has {} entries, not {}", name, values.size(), readings));
  return values;
}

void check_known(const std::vector<KnownDistance>& distances) {
  for (const KnownDistance& known : distances)
    if (!(known.distance_m > 0.0) || !(known.sigma_m > 0.0))
      throw InputError("simulation: known_distances holds one that is not positive");
}

void recording_from_json(const Json& json, SimulationModel& model) {
  Recording r;
  r.kind = json.at("kind") == "pairs" ? RecordingKind::pairs : RecordingKind::landmarks;
  const Json& sensor = json.at("sensor");
  r.sensor.name = sensor.at("name");
  r.sensor.principle = sensor.at("principle");
  r.sensor.range_min_m = sensor.at("range_min_m");
  if (!sensor.at("range_max_m").is_null()) r.sensor.range_max_m = sensor.at("range_max_m");
  r.sigma_xy_m = json.at("sigma_xy_m");
  r.estimate_sigma_xy = json.at("estimate_sigma_xy");
  r.sigma_heading_rad = json.at("sigma_heading_rad");
  r.stop_error =
      json.at("error") == "random_walk" ? StopErrorModel::random_walk : StopErrorModel::independent;
  for (const Json& s : json.at("stops")) {
    Stop stop;
    stop.label = s.at("stop");
    stop.commanded = {s.at("x_m").get<double>(), s.at("y_m").get<double>(),
                      s.at("heading_rad").get<double>()};
    if (s.contains("sigma_xy_m")) stop.sigma_xy_m = s.at("sigma_xy_m").get<double>();
    if (s.contains("sigma_heading_rad")) stop.sigma_heading_rad = s.at("sigma_heading_rad").get<double>();
    if (s.contains("place")) stop.place = s.at("place");
    if (s.contains(covariance_columns[0])) {
      CovarianceEntries entries;
      for (std::size_t i = 0; i < entries.size(); ++i) entries[i] = s.at(covariance_columns[i]).get<double>();
      const StopCovariance covariance = stop_covariance(entries, 0.0);
      if (!covariance.fault.empty())
        throw InputError(fmt::format("simulation: {} of stop '{}' {}", covariance_columns[covariance.at],
                                     stop.label, covariance.fault));
      stop.covariance = covariance.matrix;
    }
    r.stops.push_back(stop);
  }
  const int index = static_cast<int>(model.recordings.size());
  for (const Json& l : json.at("landmarks")) {
    Landmark landmark;
    landmark.label = l.at("landmark");
    landmark.radius_m = l.at("radius_m");
    if (l.contains("reflectance")) landmark.reflectance = l.at("reflectance").get<double>();
    r.landmarks.push_back(landmark);
    if (l.contains("x_m"))
      model.calibration.landmarks.push_back(
          {index, landmark.label, {l.at("x_m").get<double>(), l.at("y_m").get<double>()}, std::nullopt});
  }
  const auto landmark_index = [&](const Json& known, const char* key) {
    return whole_number(known.at(key), key, 0, static_cast<int>(r.landmarks.size()) - 1);
  };
  for (const Json& k : json.at("known_distances"))
    r.known_distances.push_back(
        {landmark_index(k, "from"), landmark_index(k, "to"), k.at("distance_m"), k.at("sigma_m")});
  check_known(r.known_distances);
  const Json& readings = json.at("readings");
  std::vector<int> read;
  std::size_t count = 0;
  if (r.kind == RecordingKind::pairs) {
    Pairs& pairs = r.pairs;
    pairs.true_m = column_of(readings, "true_m");
    count = pairs.true_m.size();
    for (const double d : pairs.true_m)
      if (!(d > 0.0)) throw InputError("simulation: true_m holds a distance that is not positive");
    pairs.batch_labels = list_of<std::string>(readings, "batch_labels");
    if (holds(readings, "batch"))
      pairs.batch = indices_of(readings, "batch", pairs.batch_labels.size(), count, true);
    if (holds(readings, "landmark"))
      pairs.landmark = indices_of(readings, "landmark", r.landmarks.size(), count);
    pairs.time_s = column_of(readings, "time_s", count);
    pairs.bearing_rad = column_of(readings, "bearing_rad", count);
    pairs.reading_m.assign(count, 1.0);
  } else {
    count = readings.at("stop").size();
    r.readings.stop = indices_of(readings, "stop", r.stops.size(), count);
    r.readings.landmark = indices_of(readings, "landmark", r.landmarks.size(), count);
    r.readings.repeat =
        indices_of(readings, "repeat", static_cast<std::size_t>(std::numeric_limits<int>::max()), count);
    r.readings.time_s = column_of(readings, "time_s", count);
    read = r.readings.landmark;
    if (readings.contains("landmark_read"))
      read = indices_of(readings, "landmark_read", r.landmarks.size(), count);
    r.readings.range_m.assign(count, 1.0);
    r.readings.bearing_rad.assign(count, 0.0);
  }
  Covariates& columns = covariates_of(r);
  for (const auto& [name, values] : readings.at("covariates").items())
    columns[name] = column_of(readings.at("covariates"), name.c_str(), count);
  AddedChange added;
  if (readings.contains("added")) {
    const Json& changes = readings.at("added");
    added = {column_of(changes, "range_m", count), column_of(changes, "bearing_rad", count),
             column_of(changes, "range_log_variance", count),
             column_of(changes, "bearing_log_variance", count)};
  }
  model.recordings.push_back(std::move(r));
  model.landmark_read.push_back(std::move(read));
  model.added.push_back(std::move(added));
}

}  // namespace

std::string simulation_model_to_json(const SimulationModel& model) {
  const Calibration& c = model.calibration;
  Json json;
  json["curve"] = json_of(c.scale);
  json["alpha"] = std::vector<double>(c.alpha.begin(), c.alpha.end());
  json["noise"] = {{"law", to_string(c.noise.law)},
                   {"parameters", std::vector<double>(c.noise.parameters.begin(), c.noise.parameters.end())}};
  json["sigma_theta_rad"] = c.sigma_theta_rad ? number(c.sigma_theta_rad->value) : Json(nullptr);
  json["sigma_s_m"] = c.sigma_s_m ? number(c.sigma_s_m->value) : Json(nullptr);
  json["effects"] = Json::object();
  for (const auto& [id, parameters] : c.effects) {
    json["effects"][id] = Json::object();
    for (const auto& [name, value] : parameters) json["effects"][id][name] = number(value);
  }
  json["recordings"] = Json::array();
  for (std::size_t r = 0; r < model.recordings.size(); ++r)
    json["recordings"].push_back(recording_to_json(model, r));
  return json.dump();
}

SimulationModel simulation_model_from_json(const std::string& text, const std::string& file) {
  try {
    const Json whole = Json::parse(text);
    const Json& json = whole.contains("simulation") ? whole.at("simulation") : whole;
    SimulationModel model;
    Calibration& c = model.calibration;
    const std::vector<double> alpha = json.at("alpha").get<std::vector<double>>();
    const std::vector<double> noise = json.at("noise").at("parameters").get<std::vector<double>>();
    if (alpha.empty() || noise.empty()) throw InputError("alpha or noise is empty");
    if (const auto found = json.find("curve"); found != json.end()) {  // of older ones a polynomial
      nlohmann::json curve = *found;
      if (curve.value("family", "") == to_string(CurveFamily::polynomial))
        curve.erase("offset_m");  // of older ones 0
      JsonFields(curve, "curve").convert(c.scale);
    }
    c.alpha = Eigen::Map<const Eigen::VectorXd>(alpha.data(), static_cast<Eigen::Index>(alpha.size()));
    c.noise.law = noise_law_from_string(json.at("noise").at("law").get<std::string>());
    c.noise.parameters =
        Eigen::Map<const Eigen::VectorXd>(noise.data(), static_cast<Eigen::Index>(noise.size()));
    if (has_sigma(c.noise.law) && (noise.size() != 1 || !(noise[0] > 0.0)))
      throw InputError("field 'noise.parameters' is not one positive number");
    if (!json.at("sigma_theta_rad").is_null())
      c.sigma_theta_rad = Estimate{json.at("sigma_theta_rad").get<double>(), {}};
    if (!json.at("sigma_s_m").is_null()) c.sigma_s_m = Estimate{json.at("sigma_s_m").get<double>(), {}};
    for (const auto& [id, parameters] : json.at("effects").items())
      for (const auto& [name, value] : parameters.items()) c.effects[id][name] = number_of(value);
    for (const Json& recording : json.at("recordings")) recording_from_json(recording, model);
    if (!model.recordings.empty()) c.kind = model.recordings[0].kind;
    return model;
  } catch (const nlohmann::json::exception& error) {
    throw InputError(file, 0, "", "is no diagnosis with a simulation in it: " + json_complaint(error));
  } catch (const InputError& error) {
    throw InputError(file, 0, "", error.what());
  }
}

}  // namespace rangecal
