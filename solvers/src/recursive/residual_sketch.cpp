// SPDX-License-Identifier: BSD-3-Clause
#include "recursive/residual_sketch.hpp"

#include <algorithm>
#include <cmath>

#include "recursive/signed_intervals.hpp"

namespace rangecal {
namespace {

constexpr SignedIntervals intervals_of_z{.width = 0.25, .even_to = 8.0, .ratio = 1.1, .farthest = 1e9};

}  // namespace

void ResidualSketch::add(double z, double s, double weight) {
  constexpr double ratio = 1.3;
  const auto step = static_cast<int>(std::floor(std::log(s) / std::log(ratio)));
  auto& sums = cells[{intervals_of_z.index_of(z), step}];
  sums[0] += weight;
  sums[1] += weight * z;
  sums[2] += weight * z * z;
  sums[3] += weight * s;
}

void ResidualSketch::scale(double factor) {
  for (auto& [place, sums] : cells)
    for (double& sum : sums) sum *= factor;
  std::erase_if(cells, [](const auto& cell) { return !(cell.second[0] > 1e-12); });
}

void ResidualSketch::append_to(ChannelResiduals& points) const {
  if (points.weight.empty()) points.weight.assign(points.z.size(), 1.0);
  for (const auto& [place, sums] : cells) {
    const double mean = sums[1] / sums[0], square = sums[2] / sums[0] - mean * mean,
                 half_width = std::sqrt(std::max(0.0, square));
    for (const double sign : {-1.0, 1.0}) {
      points.z.push_back(mean + sign * half_width);
      points.s.push_back(sums[3] / sums[0]);
      points.weight.push_back(0.5 * sums[0]);
    }
  }
}

}  // namespace rangecal
