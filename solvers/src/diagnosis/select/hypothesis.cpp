// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/hypothesis.hpp"

#include <algorithm>

namespace rangecal::diagnosis {

bool is_nameless(const Effect& effect) { return find_effect(effect.info().id) == nullptr; }

std::string curve_name(const std::string& channel, const std::string& covariate) {
  return "curve of " + channel + " along " + covariate;
}

std::string member_name(const Effect& effect) {
  const EffectInfo& info = effect.info();
  return is_nameless(effect) ? curve_name(info.channel, info.covariate) : info.id;
}

std::vector<std::string> member_names(const Model& model, std::size_t known) {
  std::vector<std::string> names;
  for (std::size_t i = known; i < model.size(); ++i) names.push_back(member_name(*model[i].effect));
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace rangecal::diagnosis
