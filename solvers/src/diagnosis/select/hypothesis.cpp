// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/hypothesis.hpp"

#include <fmt/ranges.h>

#include <algorithm>

#include "diagnosis/generic.hpp"

namespace rangecal::diagnosis {

TriedSet tried_set(const Hypothesis& h, double probability, std::size_t known) {
  return {member_names(h.fit.model, known),
          h.parent,
          h.predicted_gain,
          h.gain,
          h.parameter_volume,
          h.formula_allowance,
          h.prior_mass,
          h.log_posterior,
          probability,
          h.scanned,
          h.proposals};
}

bool is_generic(const Effect& effect) { return dynamic_cast<const GenericEffect*>(&effect) != nullptr; }

bool has_generic(const Model& model) {
  return std::any_of(model.begin(), model.end(), [](const ActiveEffect& a) { return is_generic(*a.effect); });
}

Model without(Model model, std::size_t index) {
  model.erase(model.begin() + static_cast<std::ptrdiff_t>(index));
  return model;
}

Model without_curves(Model model) {
  std::erase_if(model, [](const ActiveEffect& a) { return is_generic(*a.effect); });
  return model;
}

bool is_curve_along(const Effect& effect, const EffectInfo& name) {
  const auto along =
      [](const EffectInfo& info) {  // of covariates that are functions of one another, one for all
        if (info.covariate == "disparity") return std::string("range");
        return info.covariate == "stop" ? "time" : info.covariate;
      };
  return is_generic(effect) && effect.info().channel == name.channel && along(effect.info()) == along(name);
}

std::string curve_name(const std::string& channel, const std::string& covariate) {
  return "curve of " + channel + " along " + covariate;
}

std::string member_name(const Effect& effect) {
  const EffectInfo& info = effect.info();
  return is_generic(effect) ? curve_name(info.channel, info.covariate) : info.id;
}

std::string set_in_words(const std::vector<std::string>& members) {
  return members.empty() ? "no cause" : fmt::format("{}", fmt::join(members, " + "));
}

std::vector<std::string> curve_names(const Model& model) {
  std::vector<std::string> names;
  for (const ActiveEffect& active : model)
    if (is_generic(*active.effect)) names.push_back(member_name(*active.effect));
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<std::string> member_names(const Model& model, std::size_t known) {
  std::vector<std::string> names;
  for (std::size_t i = known; i < model.size(); ++i) names.push_back(member_name(*model[i].effect));
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace rangecal::diagnosis
