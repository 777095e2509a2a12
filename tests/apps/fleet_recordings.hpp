// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "rangecal/core/random.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::test {

/// Units u000, u001, ..: alpha_0 ~ N(0.05, 0.02^2), alpha_1 ~ N(0.9, 0.03^2), s = 0.01 f^2. u007 lies 0.4 m off; u011 has
/// 3 readings; u013's file is broken.
inline void write_fleet(const TemporaryFolder& folder, int units, int readings) {
  for (int u = 0; u < units; ++u) {
    Random random(seed_from("fleet", {static_cast<std::uint64_t>(u)}));
    const std::string path = fmt::format("{}/fleet/u{:03}", folder.path(), u);
    std::filesystem::create_directories(path);
    std::ofstream(path + "/recording.yaml")
        << "format: rangecal/1\nkind: pairs\nsensor: {name: unit, principle: triangulation}\n";
    std::ofstream pairs(path + "/pairs.csv");
    pairs << "true_m,reading_m\n";
    const double offset = random.normal(0.05, 0.02) + (u == 7 ? 0.4 : 0.0), slope = random.normal(0.9, 0.03);
    for (int i = 0; i < (u == 11 ? 3 : readings); ++i) {
      const double d = random.uniform(0.5, 4.0), f = offset + slope * d;
      pairs << fmt::format("{:.5f},{:.5f}\n", d, random.normal(f, 0.01 * f * f));
    }
    if (u == 13) pairs << "far,1\n";
  }
}

}  // namespace rangecal::test
