// SPDX-License-Identifier: BSD-3-Clause
#include "statistics/kurtosis_law.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace rangecal {
namespace {

constexpr double first_score = -6.5, score_step = 0.5;
constexpr std::size_t score_count = 27;

struct Quantiles {
  double n;
  std::array<double, score_count> at;  ///< (b - E b) / sqrt(var b) of each score
};

constexpr std::array<Quantiles, 15> quantile_table = {{
    {20.0, {-2.102, -2.059, -2.013, -1.947, -1.875, -1.788, -1.692, -1.578, -1.443,
            -1.282, -1.090, -0.858, -0.573, -0.215, 0.239,  0.831,  1.612,  2.650,
            4.006,  5.702,  7.679,  9.814,  11.971, 14.025, 15.878, 17.452, 18.717}},
    {30.0, {-2.289, -2.229, -2.160, -2.083, -1.998, -1.897, -1.783, -1.652, -1.500,
            -1.322, -1.115, -0.868, -0.571, -0.204, 0.254,  0.838,  1.599,  2.606,
            3.941,  5.680,  7.852,  10.418, 13.281, 16.323, 19.414, 22.431, 25.275}},
    {45.0, {-2.503, -2.428, -2.343, -2.248, -2.145, -2.029, -1.893, -1.743, -1.572,
            -1.376, -1.148, -0.883, -0.567, -0.189, 0.276,  0.856,  1.595,  2.561,
            3.838,  5.528,  7.716,  10.444, 13.695, 17.409, 21.492, 25.827, 30.281}},
    {65.0, {-2.722, -2.632, -2.529, -2.417, -2.295, -2.158, -2.006, -1.837, -1.645,
            -1.428, -1.182, -0.898, -0.565, -0.174, 0.297,  0.874,  1.595,  2.519,
            3.730,  5.332,  7.438,  10.140, 13.487, 17.482, 22.094, 27.262, 32.902}},
    {100.0, {-3.001, -2.887, -2.764, -2.630, -2.484, -2.323, -2.148, -1.953, -1.737,
             -1.495, -1.223, -0.916, -0.563, -0.154, 0.323,  0.896,  1.594,  2.468,
             3.589,  5.057,  6.995,  9.524,  12.744, 16.722, 21.496, 27.072, 33.433}},
    {150.0, {-3.278, -3.143, -2.996, -2.839, -2.669, -2.483, -2.282, -2.063, -1.822,
             -1.557, -1.262, -0.933, -0.560, -0.140, 0.346,  0.916,  1.594,  2.420,
             3.454,  4.785,  6.529,  8.820,  11.781, 15.520, 20.112, 25.620, 32.088}},
    {220.0, {-3.547, -3.388, -3.219, -3.038, -2.844, -2.634, -2.408, -2.167, -1.902,
             -1.612, -1.294, -0.945, -0.558, -0.123, 0.369,  0.932,  1.590,  2.374,
             3.330,  4.533,  6.089,  8.126,  10.781, 14.175, 18.411, 23.573, 29.742}},
    {300.0, {-3.765, -3.587, -3.399, -3.196, -2.983, -2.755, -2.509, -2.246, -1.961,
             -1.655, -1.322, -0.956, -0.558, -0.112, 0.383,  0.943,  1.586,  2.337,
             3.235,  4.341,  5.747,  7.577,  9.966,  13.045, 16.920, 21.688, 27.443}},
    {500.0, {-4.120, -3.908, -3.685, -3.451, -3.203, -2.941, -2.663, -2.368, -2.054,
             -1.718, -1.359, -0.969, -0.549, -0.090, 0.407,  0.964,  1.586,  2.284,
             3.095,  4.057,  5.243,  6.750,  8.712,  11.258, 14.502, 18.543, 23.478}},
    {750.0, {-4.387, -4.152, -3.903, -3.641, -3.366, -3.080, -2.778, -2.454, -2.116,
             -1.761, -1.383, -0.979, -0.541, -0.072, 0.435,  0.979,  1.579,  2.244,
             2.993,  3.862,  4.896,  6.180,  7.825,  9.966,  12.722, 16.183, 20.435}},
    {1500.0, {-4.815, -4.530, -4.237, -3.931, -3.616, -3.287, -2.943, -2.587, -2.213,
              -1.823, -1.412, -0.990, -0.536, -0.069, 0.435,  0.983,  1.565,  2.180,
              2.853,  3.597,  4.438,  5.419,  6.616,  8.153,  10.151, 12.704, 15.889}},
    {3000.0, {-5.185, -4.857, -4.523, -4.179, -3.824, -3.459, -3.078, -2.696, -2.291,
              -1.871, -1.436, -0.989, -0.516, -0.039, 0.464,  0.998,  1.551,  2.127,
              2.743,  3.413,  4.127,  4.907,  5.798,  6.865,  8.228,  10.023, 12.323}},
    {10000.0, {-5.678, -5.293, -4.894, -4.496, -4.090, -3.679, -3.252, -2.818, -2.380,
               -1.924, -1.462, -1.017, -0.543, -0.040, 0.479,  0.982,  1.521,  2.056,
               2.618,  3.211,  3.809,  4.432,  5.076,  5.767,  6.494,  7.350,  8.403}},
    {30000.0, {-5.983, -5.549, -5.137, -4.698, -4.251, -3.810, -3.350, -2.877, -2.434,
               -1.940, -1.479, -0.995, -0.502, -0.039, 0.483,  1.028,  1.503,  2.031,
               2.586,  3.135,  3.659,  4.212,  4.802,  5.399,  5.988,  6.602,  7.223}},
    {100000.0, {-6.197, -5.746, -5.283, -4.817, -4.360, -3.898, -3.430, -2.932, -2.449,
                -1.974, -1.486, -1.011, -0.517, 0.016,  0.509,  0.981,  1.506,  2.018,
                2.536,  3.064,  3.578,  4.130,  4.649,  5.198,  5.746,  6.304,  6.840}},
}};

double score_of(std::size_t index) { return first_score + score_step * static_cast<double>(index); }

/// The quantiles for n values, interpolated linearly in 1 / sqrt(n); for infinite n those of a normal distribution.
std::array<double, score_count> quantiles_for(double n) {
  std::size_t above = 0;
  while (above < quantile_table.size() && quantile_table[above].n <= n) ++above;
  const Quantiles& low = quantile_table[above == 0 ? 0 : above - 1];
  const bool last = above == quantile_table.size();
  const double from = 1.0 / std::sqrt(low.n), to = last ? 0.0 : 1.0 / std::sqrt(quantile_table[above].n);
  const double share = (from - 1.0 / std::sqrt(n)) / (from - to);
  std::array<double, score_count> at{};
  for (std::size_t i = 0; i < score_count; ++i) {
    const double next = last ? score_of(i) : quantile_table[above].at[i];
    at[i] = low.at[i] + share * (next - low.at[i]);
  }
  return at;
}

}  // namespace

double kurtosis_score(double kurtosis, double n) {
  if (!(n >= quantile_table.front().n)) return 0.0;
  const double mean = 3.0 * n / (n + 2.0);
  const double deviation =
      std::sqrt(24.0 * n * n * (n - 1.0) / ((n + 2.0) * (n + 2.0) * (n + 4.0) * (n + 6.0)));
  const double x = (kurtosis - mean) / deviation;
  const std::array<double, score_count> at = quantiles_for(n);
  if (x > at.back())
    return score_of(score_count - 1) + anscombe_glynn(kurtosis, n) -
           anscombe_glynn(mean + at.back() * deviation, n);
  const auto next = std::upper_bound(at.begin() + 1, at.end() - 1, x);  // the lowest interval is extended
  const auto i = static_cast<std::size_t>(next - at.begin()) - 1;
  return score_of(i) + score_step * (x - at[i]) / (at[i + 1] - at[i]);
}

double anscombe_glynn(double kurtosis, double n) {
  const double mean = 3.0 * (n - 1.0) / (n + 1.0);
  const double variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) * (n + 1.0) * (n + 3.0) * (n + 5.0));
  const double x = (kurtosis - mean) / std::sqrt(variance);
  const double moment = 6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0)) *
                        std::sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)));
  const double a = 6.0 + 8.0 / moment * (2.0 / moment + std::sqrt(1.0 + 4.0 / (moment * moment)));
  const double cube = (1.0 - 2.0 / a) / (1.0 + x * std::sqrt(2.0 / (a - 4.0)));
  return (1.0 - 2.0 / (9.0 * a) - std::cbrt(cube)) / std::sqrt(2.0 / (9.0 * a));
}

}  // namespace rangecal
