// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/effects/effect.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <map>
#include <mutex>

#include "added_effects.hpp"

namespace rangecal {

double difference_step(const EffectParameter& parameter, double value) {
  constexpr double relative = 1e-6, least_size = 1e-9;
  const bool positive = parameter.low > 0.0 && value > 0.0;
  return relative * std::max(positive ? value : std::abs(parameter.typical), least_size);
}

double Effect::switching_distance(const double*) const { return std::numeric_limits<double>::quiet_NaN(); }

std::pair<double, double> Effect::bounds(const EffectContext&, std::size_t parameter) const {
  return {info().parameters[parameter].low, info().parameters[parameter].high};
}

std::vector<std::pair<std::string, double>> Effect::reported(const EffectContext&, const double* p) const {
  std::vector<std::pair<std::string, double>> values;
  for (std::size_t i = 0; i < info().parameters.size(); ++i)
    values.emplace_back(info().parameters[i].name, p[i]);
  return values;
}

std::vector<Eigen::VectorXd> grid_of(const std::vector<std::vector<double>>& axes) {
  std::vector<Eigen::VectorXd> points{Eigen::VectorXd::Zero(static_cast<Eigen::Index>(axes.size()))};
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    std::vector<Eigen::VectorXd> next;
    for (const Eigen::VectorXd& point : points)
      for (double value : axes[axis]) {
        next.push_back(point);
        next.back()[static_cast<Eigen::Index>(axis)] = value;
      }
    points = std::move(next);
  }
  return points;
}

namespace {

constexpr char before_column = ':';

const Effect* in_registry(const std::string& id) {
  for (const auto& effect : effect_registry())
    if (effect->info().id == id) return effect.get();
  return nullptr;
}

/// Effects beside the catalogue.
class AddedEffects {
 public:
  void add(std::unique_ptr<Effect> effect) {
    const std::lock_guard<std::mutex> lock(mutex_);
    added_.push_back(std::move(effect));
  }
  std::vector<const Effect*> all() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::vector<const Effect*> effects;
    for (const auto& effect : added_) effects.push_back(effect.get());
    return effects;
  }
  const Effect* find(const std::string& id) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const auto& effect : added_)
      if (effect->info().id == id) return effect.get();
    return nullptr;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::unique_ptr<Effect>> added_;
};

AddedEffects& beside_catalogue() {
  static AddedEffects effects;
  return effects;
}

/// Effects along columns, by id, made when they are first asked for.
class EffectsAlongColumns {
 public:
  const Effect* find(const std::string& id) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto known = made_.find(id);
    if (known != made_.end()) return known->second.get();
    const Effect* kind = in_registry(id_without_column(id));
    std::unique_ptr<Effect> made = kind ? kind->along(column_in_id(id)) : nullptr;
    return made ? made_.emplace(id, std::move(made)).first->second.get() : nullptr;
  }

 private:
  std::mutex mutex_;
  std::map<std::string, std::unique_ptr<Effect>> made_;
};

}  // namespace

std::string Effect::lacking(const EffectContext& context) const {
  const bool of_bearings = info().channel.rfind("bearing", 0) == 0;
  return of_bearings && !context.reads_bearings ? "bearings (column bearing_rad)" : missing(context);
}

std::string id_without_column(const std::string& id) { return id.substr(0, id.find(before_column)); }

std::string column_in_id(const std::string& id) {
  const std::size_t at = id.find(before_column);
  return at == std::string::npos ? "" : id.substr(at + 1);
}

std::string id_in_words(const std::string& id) {
  const std::string column = column_in_id(id);
  return column.empty() ? id : id_without_column(id) + " along " + column;
}

std::string ids_in_words(const std::vector<std::string>& ids, const std::string& between) {
  std::string words;
  for (const std::string& id : ids) words += (words.empty() ? "" : between) + id_in_words(id);
  return words;
}

void add_effect(std::unique_ptr<Effect> effect) { beside_catalogue().add(std::move(effect)); }

std::vector<const Effect*> added_effects() { return beside_catalogue().all(); }

std::vector<const Effect*> known_effects() {
  std::vector<const Effect*> effects;
  for (const auto& effect : effect_registry()) effects.push_back(effect.get());
  for (const Effect* effect : added_effects()) effects.push_back(effect);
  return effects;
}

const Effect* find_effect(const std::string& id) {
  if (const Effect* effect = in_registry(id)) return effect;
  if (const Effect* effect = beside_catalogue().find(id)) return effect;
  if (column_in_id(id).empty()) return nullptr;
  static EffectsAlongColumns along_columns;
  return along_columns.find(id);
}

std::vector<std::string> exact_twins_of(const std::string& id) {
  const Effect* effect = find_effect(id);
  return effect ? effect->info().exact_twins : std::vector<std::string>();
}

Carrier carrier_of(const std::string& principle) {
  std::string words = principle;
  std::transform(words.begin(), words.end(), words.begin(), [](unsigned char c) { return std::tolower(c); });
  const auto says = [&](std::initializer_list<const char*> any) {
    return std::any_of(any.begin(), any.end(),
                       [&](const char* word) { return words.find(word) != std::string::npos; });
  };
  if (says({"sonar", "sound", "sonic", "acoustic"})) return Carrier::sound;
  if (says({"radio", "uwb", "ultra-wideband", "radar", "bluetooth"})) return Carrier::radio;
  if (says({"camera", "triangulation", "lidar", "laser", "stereo", "infrared", "light"}))
    return Carrier::light;
  return Carrier::not_known;
}

Carrier carrier_of(const Recording& recording) {
  for (const std::string& words : {recording.sensor.principle, recording.sensor.name})
    if (const Carrier carrier = carrier_of(words); carrier != Carrier::not_known) return carrier;
  const Covariates& columns = covariates_of(recording);
  const bool reads_power = std::any_of(columns.begin(), columns.end(), [&](const auto& named) {
    return column_of(recording, named.first).unit == "dBm";
  });
  return reads_power ? Carrier::radio : Carrier::not_known;
}

std::vector<const Effect*> effects_of(const EffectContext& context) {
  std::vector<const Effect*> effects;
  for (const Effect* effect : known_effects()) {
    const Carrier needs = effect->info().carrier;
    if (needs != Carrier::not_known && context.carrier != Carrier::not_known && needs != context.carrier)
      continue;
    const std::size_t before = effects.size();
    for (std::size_t c = 0; c < context.columns.size(); ++c)
      if (const ColumnSummary& column = context.columns[c];
          column.std_dev > 0.0 && effect->lies_along(column.role))
        effects.push_back(find_effect(effect->info().id + before_column + context.covariates[c]));
    // The kind itself where it needs no column, or for a column that is lacking.
    if (effects.size() == before || effect->lacking(context).empty()) effects.push_back(effect);
  }
  std::erase_if(effects, [&](const Effect* effect) {
    const std::string& id = effect->info().id;
    return std::any_of(context.left_out.begin(), context.left_out.end(), [&](const std::string& left_out) {
      return left_out == id || left_out == id_without_column(id);
    });
  });
  return effects;
}

}  // namespace rangecal
