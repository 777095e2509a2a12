// SPDX-License-Identifier: BSD-3-Clause
#include <iostream>

#include "rangecal/problems/effects/effect.hpp"

int main() {
  for (const auto& effect : rangecal::effect_registry()) std::cout << effect->info().id << '\n';
}
